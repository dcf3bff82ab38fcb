# Built from the sources: docker build -t eaves . (a release: --build-arg SETUPTOOLS_SCM_PRETEND_VERSION=0.2.0); run: docker run --rm -v "$PWD:/data" eaves build tile.laz -o out
FROM debian:bookworm-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends python3-venv && rm -rf /var/lib/apt/lists/*
COPY pyproject.toml README.md LICENSE /source/
ARG SETUPTOOLS_SCM_PRETEND_VERSION
COPY src /source/src
RUN python3 -m venv /opt/eaves && /opt/eaves/bin/pip install --no-cache-dir --only-binary :all: \
    --no-binary eaves "/source[parquet]"
# The kernels are compiled once, here, and not in every container.
RUN /opt/eaves/bin/eaves doctor

FROM debian:bookworm-slim
RUN apt-get update && apt-get install -y --no-install-recommends python3 libexpat1 \
    && rm -rf /var/lib/apt/lists/* && useradd --create-home eaves
COPY --from=build /opt/eaves /opt/eaves
ENV PATH=/opt/eaves/bin:$PATH
USER eaves
WORKDIR /data
ENTRYPOINT ["eaves"]
CMD ["--help"]
