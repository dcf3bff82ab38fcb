"""Points by http and https: whole files, of COPC what a rectangle needs, and lists of files (VPC, STAC)."""

from __future__ import annotations

import hashlib
import io
import json
import re
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from http.client import HTTPException, HTTPResponse
from pathlib import Path, PurePosixPath
from typing import Any, TypeGuard
from urllib.parse import urljoin, urlsplit, urlunsplit

import laspy
import lazrs
import numpy as np
import pyproj
from laspy.copc import Bounds as CopcBounds
from laspy.copc import CopcReader
from laspy.errors import LaspyException

from eaves.formats.errors import InputError
from eaves.formats.inputs import LAS_SUFFIXES
from eaves.formats.points.converted import convert, is_converted
from eaves.formats.whole_files import atomic
from eaves.model import Rectangle

SCHEMES = ("http", "https")
LISTS = (".vpc", ".json", ".geojson")
PATIENCE_S, ATTEMPTS, REDIRECTS = 30.0, 3, 5
"""Seconds without an answer, times that a request is made, and redirects that are followed."""
SLOWEST = 4096
"""Bytes per second of the slowest answer: one that drips would never end."""
PIECE = 1 << 14
"""Bytes of the shortest request: a header is read in one."""
LARGEST_LIST = 1 << 28
"""Bytes of a list; a country's is a twentieth of it."""
DEEPEST = 32
"""Levels of an EPT: a cube of the size of the Earth has nodes of 3 mm."""
AGAIN = "check the address, and try again"


@dataclass
class Traffic:
    """The bytes that were read over the network, and those of the files asked for."""

    read: int = 0
    whole: int = 0
    addresses: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """For run.json."""
        return {"bytes_read": self.read, "bytes": self.whole, "addresses": self.addresses}


def is_address(text: str | Path) -> TypeGuard[str]:
    """True if an input is an address and not a path."""
    return isinstance(text, str) and "://" in text


def shown(address: str) -> str:
    """An address without what may be secret: user, query and fragment."""
    parts = urlsplit(address)
    return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path, "", ""))


class _Redirects(urllib.request.HTTPRedirectHandler):
    max_redirections = REDIRECTS

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        fp.close()
        check_address(newurl)
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def check_address(address: str) -> None:
    """Refuse what is not http or https, or names a user.

    Raises
    ------
    InputError
        When it is not.
    """
    parts = urlsplit(address)
    if parts.scheme not in SCHEMES or not parts.hostname:
        raise InputError.about(
            shown(address), "is neither http nor https", "download it, or give such an address"
        )
    if parts.username is not None:
        raise InputError.about(shown(address), "names a user", "give a signed address, or download the file")


class RemoteFile(io.RawIOBase):
    """A file behind http or https that is read by ranges. `traffic` counts the bytes; a request is given up
    after `patience` seconds without an answer."""

    def __init__(self, address: str, traffic: Traffic, patience: float = PATIENCE_S) -> None:
        check_address(address)
        self.address, self.traffic, self.place, self.patience = address, traffic, 0, patience
        self.size, self.version = -1, ""
        self._head = self._get(0, PIECE)
        self._last = 0, self._head

    def _get(self, start: int, length: int) -> bytes:
        request = urllib.request.Request(
            self.address,
            headers={"Range": f"bytes={start}-{start + length - 1}", "Accept-Encoding": "identity"},
        )
        for attempt in range(ATTEMPTS):
            try:
                with urllib.request.build_opener(_Redirects()).open(request, timeout=self.patience) as answer:
                    stated = re.fullmatch(
                        rf"bytes {start}-\d+/(\d+)", answer.headers.get("Content-Range") or ""
                    )
                    if answer.status != 206 or stated is None:
                        raise InputError.about(
                            shown(self.address),
                            "its server gives no ranges of bytes",
                            "download the file and give its path",
                        )
                    known = answer.headers.get("ETag") or answer.headers.get("Last-Modified") or ""
                    if self.size >= 0 and (int(stated[1]), known) != (self.size, self.version):
                        raise InputError.about(shown(self.address), "changed while it was read", AGAIN)
                    self.size, self.version = int(stated[1]), known
                    data = read_answer(answer, length, self.patience)
                    self.traffic.read += len(data)
                    if len(data) < min(length, self.size - start):
                        raise OSError("the answer is cut off")
                    return data
            except urllib.error.HTTPError as error:
                error.close()
                if error.code < 500 or attempt == ATTEMPTS - 1:
                    raise InputError.about(
                        shown(self.address), f"the server answers {error.code}", AGAIN
                    ) from None
            except (OSError, HTTPException) as error:
                if attempt == ATTEMPTS - 1:
                    reason = getattr(error, "reason", None) or error
                    words = getattr(reason, "strerror", None) or type(reason).__name__
                    if isinstance(reason, TimeoutError):
                        words = f"no answer within {self.patience:g} s"
                    raise InputError.about(shown(self.address), f"cannot be read ({words})", AGAIN) from None
            time.sleep(0.3 * 2**attempt)
        raise AssertionError

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self.place = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self.place, io.SEEK_END: self.size}[whence]
        return self.place

    def tell(self) -> int:
        return self.place

    def readinto(self, buffer: Any) -> int:
        length = max(0, min(len(buffer), self.size - self.place))
        if length == 0:
            return 0
        end = self.place + length
        for start, held in ((0, self._head), self._last):  # laspy reads the root of an octree twice
            if start <= self.place and end <= start + len(held):
                break
        else:
            start, held = self._last = self.place, self._get(self.place, max(length, PIECE))
        buffer[:length] = held[self.place - start : end - start]
        self.place = end
        return length


def read_answer(answer: HTTPResponse, length: int, patience: float) -> bytes:
    """So many bytes of an answer, or all where there are fewer.

    Raises
    ------
    TimeoutError
        When they come slower than `SLOWEST`, but for the seconds of `patience`.
    """
    data, end = bytearray(), time.monotonic() + patience
    while piece := answer.read1(length - len(data)):
        data += piece
        if time.monotonic() > end + len(data) / SLOWEST:
            raise TimeoutError
    return bytes(data)


def localise(
    inputs: str | Path | Sequence[str | Path],
    folder: Path,
    bounds: Rectangle | None = None,
    clip: Path | None = None,
    dtm: Path | None = None,
) -> tuple[list[str | Path], Traffic]:
    """The inputs with a local file in the place of each address and each list.

    Parameters
    ----------
    inputs : str, Path or sequence of them
        Paths, globs, addresses of LAS, LAZ and COPC files, and lists of them, local or by address: virtual
        point clouds (`.vpc`), STAC items, collections of items, Entwine Point Tiles
        (`ept.json`). PLY and E57 files and rasters of heights by path or address.
    folder : Path
        Folder in which files are kept; what is there with the same size and version is not read again.
    bounds : tuple or None
        West, south, east, north in the unit of the files' system: of COPC no more is read, of a list no file
        that lies elsewhere.
    clip : Path or None
        Polygons whose box is used in the same way.
    dtm : Path or None
        Terrain under the rasters of heights.

    Returns
    -------
    list of str or Path, Traffic
        The inputs, and what was read.

    Raises
    ------
    InputError
        When an address cannot be read.
    """
    traffic, found = Traffic(), list[str | Path]()
    for given in [inputs] if isinstance(inputs, str | Path) else inputs:
        for one in files_of_list(given, bounds, traffic):
            place = fetch(one, folder, bounds, clip, traffic) if is_address(one) else one
            found.append(convert(Path(place), folder, dtm) if is_converted(place) else place)
    return found, traffic


def files_of_list(given: str | Path, bounds: Rectangle | None, traffic: Traffic) -> Iterator[str | Path]:
    """The files that a list names and that may meet the bounds; of anything else itself."""
    remote = is_address(given)
    name = urlsplit(str(given)).path if remote else str(given)
    if PurePosixPath(name).suffix.lower() not in LISTS:
        yield given
        return
    title = shown(str(given)) if remote else str(given)
    broken = InputError.about(title, "is no list of point files", "give a .vpc file, or STAC items as JSON")
    try:
        words = read_json(given, traffic)
        if "hierarchyType" in words:
            yield from nodes_of_ept(str(given), words, bounds, traffic)
            return
        features = words["features"] if words["type"] == "FeatureCollection" else [words]
        for feature in features:
            hrefs = [str(asset["href"]) for asset in feature["assets"].values()]
            href = next(one for one in hrefs if urlsplit(one).path.lower().endswith(LAS_SUFFIXES))
            box = feature.get("properties", {}).get("proj:bbox")
            if bounds is not None and box and not meets([float(side) for side in box], bounds):
                continue
            if remote:
                href = urljoin(str(given), href)
                check_address(href)
            yield href if is_address(href) else str(Path(given).parent / href)
    except InputError:
        raise
    except (KeyError, TypeError, AttributeError, StopIteration, IndexError, ValueError, RecursionError):
        raise broken from None
    except OSError as error:
        raise InputError.about(title, f"cannot be read ({error.strerror})", "check the path") from None


def read_json(given: str | Path, traffic: Traffic) -> Any:
    """The content of a file of JSON, by path or address."""
    if not is_address(given):
        if Path(given).stat().st_size > LARGEST_LIST:
            raise ValueError
        return json.loads(Path(given).read_text(encoding="utf-8"))
    stream = RemoteFile(str(given), traffic)
    if stream.size > LARGEST_LIST:
        raise ValueError
    return json.loads(stream.read(stream.size))


def nodes_of_ept(
    given: str, head: dict[str, Any], bounds: Rectangle | None, traffic: Traffic
) -> Iterator[str]:
    """The LAZ files of an Entwine Point Tile whose boxes meet the bounds, level by level."""
    if head["dataType"] != "laszip":
        reason = f"is an EPT of {head['dataType']} tiles"
        raise InputError.about(shown(given), reason, "build it again with laszip tiles")
    west, south, low, east = (float(side) for side in head["bounds"][:4])

    def beside(name: str) -> str:
        return urljoin(given, name) if is_address(given) else str(Path(given).parent / name)

    pages, nodes = ["0-0-0-0"], dict[tuple[int, ...], str]()
    for page in pages:  # it grows by the pages that are found
        for key, count in read_json(beside(f"ept-hierarchy/{page}.json"), traffic).items():
            level, column, row, height = place = tuple(map(int, key.split("-")))
            if not 0 <= level <= DEEPEST:
                raise ValueError
            name = "-".join(map(str, place))
            side = (east - west) / 2**level
            corner = west + column * side, south + row * side, low + height * side
            if bounds is not None and not meets([*corner, *(one + side for one in corner)], bounds):
                continue
            if count < 0 and name not in pages:
                pages.append(name)
            elif count > 0:
                nodes[place] = beside(f"ept-data/{name}.laz")
    yield from (nodes[place] for place in sorted(nodes))


def meets(box: list[float], bounds: Rectangle) -> bool:
    """True if a box of two or three axes meets the bounds."""
    half = len(box) // 2
    west, south, east, north = bounds
    return box[0] <= east and box[half] >= west and box[1] <= north and box[half + 1] >= south


def fetch(address: str, folder: Path, bounds: Rectangle | None, clip: Path | None, traffic: Traffic) -> Path:
    """The local file of an address: the whole file, or of COPC the points within the bounds.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    remote = RemoteFile(address, traffic)
    traffic.whole += remote.size
    traffic.addresses.append(shown(address))
    is_copc = remote._head[:4] == b"LASF" and remote._head[377:381] == b"copc"
    try:
        reader = CopcReader(remote, close_fd=False) if is_copc and (bounds or clip) else None
        rectangle = None if reader is None else needed(reader, bounds, clip)
        known = f"{shown(address)} {remote.size} {remote.version} {rectangle}"
        name = PurePosixPath(urlsplit(address).path)
        path = (
            folder
            / f"{name.name.split('.')[0]}-{hashlib.sha256(known.encode()).hexdigest()[:16]}{name.suffix}"
        )
        if path.exists():
            return path
        folder.mkdir(parents=True, exist_ok=True)
        with atomic(path) as temporary:
            if reader is None or rectangle is None:
                remote.seek(0)
                with temporary.open("wb") as file:
                    while piece := remote.read(PIECE << 8):
                        file.write(piece)
            else:
                copy_points(reader, rectangle, temporary)
    except (LaspyException, lazrs.LazrsError, ValueError, IndexError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError.about(shown(address), "is a damaged COPC file", AGAIN) from None
    return path


def needed(reader: CopcReader, bounds: Rectangle | None, clip: Path | None) -> Rectangle:
    """The rectangle that bounds and clip area leave, in the unit of the file's system."""
    boxes = [] if bounds is None else [bounds]
    if clip is not None:
        import pyogrio  # late: every run loads this module

        try:
            facts = pyogrio.read_info(clip, force_total_bounds=True)
        except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError):
            raise InputError.about(clip, "cannot be read as polygons", "check --clip") from None
        system = reader.header.parse_crs()
        box = tuple(facts["total_bounds"])
        if system is not None and facts["crs"]:
            way = pyproj.Transformer.from_crs(facts["crs"], system, always_xy=True)
            box = way.transform_bounds(*box)
        boxes.append(box)
    west, south, east, north = np.array(boxes).T
    return float(west.max()), float(south.max()), float(east.min()), float(north.min())


def copy_points(reader: CopcReader, rectangle: Rectangle, path: Path) -> None:
    """Write the points of the rectangle as LAZ."""
    west, south, east, north = rectangle
    step = np.abs(reader.header.scales[:2])  # the reader rounds the sides to whole steps
    points = reader.query(CopcBounds(np.array([west, south]) - step, np.array([east, north]) + step))
    header = reader.header
    header.vlrs = [vlr for vlr in header.vlrs if vlr.user_id != "copc"]
    header.evlrs = None
    las = laspy.LasData(header, points)
    with path.open("wb") as file:
        las.write(file, do_compress=True)
