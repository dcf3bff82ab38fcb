"""A part of `benchmarks.scale.faults`: a run that a fault meets ends with the bytes of one that none does."""

from __future__ import annotations

import random
import sys

import pytest
from benchmarks.scale.faults import CASES, ExactBench, contents, prepare
from benchmarks.scale.hostile import GOOD

from eaves.pipeline import build

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other signals")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> ExactBench:
    return prepare(tmp_path_factory.mktemp("faults"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        "killed at a write",
        *(
            pytest.param(kind, marks=pytest.mark.slow)
            for kind in ("killed", "process killed", "input lost", "clock jumps", "crowded", "asleep")
        ),
    ],
)
def test_a_run_and_the_next_end_with_the_bytes_of_an_undisturbed_run(kind: str, bench: ExactBench) -> None:
    assert CASES[kind](bench, random.Random(7), bench.place / f"case-{kind.replace(' ', '-')}") in GOOD


@pytest.mark.slow
def test_four_dask_workers_write_the_bytes_of_one_process(bench: ExactBench) -> None:
    distributed = pytest.importorskip("distributed")
    out = bench.place / "dask"
    with distributed.LocalCluster(4, threads_per_worker=1, dashboard_address=None) as cluster:
        build(bench.points, out, scheduler=cluster.scheduler_address)
    assert contents(out) == contents(bench.place / "whole")
