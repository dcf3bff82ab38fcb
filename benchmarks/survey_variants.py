"""Labelled surveys, and what can be done to one that leaves its truth as it is.

A variant is another survey of the same place: fewer echoes, fewer points, more noise, other strips, another
frame. Every point keeps its true class, so that data and truth come from one array.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
from numpy.typing import NDArray

from eaves.model import Mask, PointCloud, Points
from eaves.simulate.objects.exact import ExactScene
from eaves.simulate.standard import StandardScene

FOOT_M = 0.3048
WHOLE = "whole"
SOMEWHERE_M = np.array([480_000.0, 5_520_000.0, 0.0])
"""Where simulated towns lie, for a reference system holds nothing near its origin: whole blocks away."""
NEIGHBOURS = 9
"""Points of the little planes that a survey's noise is measured with."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Points in world metres (N, 3) with their returns, pulse, strip and true class, (N,) each."""

    name: str
    xyz: Points
    truth: NDArray[np.uint8]
    returns: NDArray[np.uint8] | None
    """Number of returns of each point's pulse; None where the scan tells none."""
    number: NDArray[np.uint8] | None
    pulse: NDArray[np.int64]
    strip: NDArray[np.int64]
    epsg: int | None = None
    height_unit: float = 1.0

    def take(self, which: Mask) -> Survey:
        """The points of a mask (N,)."""
        return replace(
            self,
            xyz=self.xyz[which],
            truth=self.truth[which],
            returns=None if self.returns is None else self.returns[which],
            number=None if self.number is None else self.number[which],
            pulse=self.pulse[which],
            strip=self.strip[which],
        )

    def cloud(self) -> tuple[PointCloud, NDArray[np.uint8]]:
        """The points in canonical order, without classes, and their true classes (N,)."""
        cloud = PointCloud.from_world(self.xyz, return_number=self.number, number_of_returns=self.returns)
        order = cloud.canonical_order()
        return cloud.take(order), self.truth[order]

    def write(self, path: Path) -> None:
        """A bare file: coordinates and returns, no class."""
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales = np.full(3, 0.0001)
        header.offsets = np.floor(self.xyz.min(axis=0))
        if self.epsg is not None:
            system = pyproj.CRS.from_epsg(self.epsg)
            if self.height_unit != 1.0:
                feet = pyproj.CRS.from_epsg(8228)  # heights in international feet
                system = pyproj.crs.CompoundCRS("survey with heights in feet", [system, feet])
            header.add_crs(system)
        las: Any = laspy.LasData(header)
        las.x, las.y, las.z = (self.xyz / [1.0, 1.0, self.height_unit]).T
        only = np.ones(len(self.xyz), np.uint8)
        las.return_number = only if self.number is None else self.number
        las.number_of_returns = only if self.returns is None else self.returns
        las.point_source_id = np.asarray(self.strip, np.uint16)
        las.gps_time = self.pulse.astype(np.float64) * 1e-5
        las.write(path)


def read_survey(name: str, paths: Sequence[Path], epsg: int | None) -> Survey:
    """The survey in some files that belong together."""
    files = [laspy.read(path) for path in paths]

    def joined(field: str) -> NDArray[np.float64]:
        return np.concatenate([np.asarray(file[field]) for file in files])

    time = np.round(joined("gps_time") * 1e6).astype(np.int64)
    pulse = np.unique(time, return_inverse=True)[1].reshape(-1)
    if len(np.unique(time)) < len(time) // 4:  # the clock is coarser than the pulses
        pulse = np.cumsum(joined("return_number") == 1)
    return Survey(
        name,
        np.column_stack([joined("x"), joined("y"), joined("z")]),
        joined("classification").astype(np.uint8),
        joined("number_of_returns").astype(np.uint8),
        joined("return_number").astype(np.uint8),
        pulse.astype(np.int64),
        joined("point_source_id").astype(np.int64),
        epsg,
    )


def simulated_survey(scene: StandardScene) -> Survey:
    """The scan of a simulated town."""
    return survey_of(scene.name, scene.make())


def survey_of(name: str, exact: ExactScene) -> Survey:
    """A simulated scan as a survey."""
    cloud = exact.cloud
    number, returns = cloud.return_number, cloud.number_of_returns
    assert number is not None and returns is not None
    return Survey(
        name,
        cloud.xyz + [*cloud.origin, 0.0] + SOMEWHERE_M,
        exact.truth_class.astype(np.uint8),
        returns,
        number,
        np.cumsum(number == 1).astype(np.int64),
        exact.strip.astype(np.int64),
        25832,
    )


def rng_of(survey: Survey, variant: str) -> np.random.Generator:
    """The same random numbers for the same survey and variant."""
    return np.random.default_rng(zlib.crc32(f"{survey.name}/{variant}".encode()))


def few_echoes(survey: Survey, share: float) -> Survey:
    """Of the pulses of several returns only a share keeps them; of the others the first return stays."""
    if survey.returns is None or survey.number is None:
        return survey
    rng = rng_of(survey, "echoes")
    lost = rng.random(int(survey.pulse.max()) + 1)[survey.pulse] >= share
    returns = np.where(lost, np.minimum(survey.returns, 1), survey.returns).astype(np.uint8)
    return replace(survey, returns=returns).take((survey.number == 1) | ~lost)


def first_returns(survey: Survey) -> Survey:
    """First returns, with no word of others."""
    assert survey.number is not None
    return replace(survey.take(survey.number == 1), returns=None, number=None)


def last_returns(survey: Survey) -> Survey:
    """Last returns, with no word of others."""
    assert survey.number is not None and survey.returns is not None
    return replace(survey.take(survey.number >= survey.returns), returns=None, number=None)


def no_fields(survey: Survey) -> Survey:
    """All points, without return fields."""
    return replace(survey, returns=None, number=None)


def thinned(survey: Survey, share: float) -> Survey:
    """A share of the pulses, each with all its returns."""
    rng = rng_of(survey, "density")
    return survey.take(rng.random(int(survey.pulse.max()) + 1)[survey.pulse] < share)


def measured_noise(survey: Survey) -> float:
    """Standard deviation (m) of heights over small planes: the lower quartile over a thousand places."""
    from scipy.spatial import cKDTree

    tree = cKDTree(survey.xyz)
    some = rng_of(survey, "noise").choice(len(survey.xyz), min(1000, len(survey.xyz)), replace=False)
    near = survey.xyz[np.asarray(tree.query(survey.xyz[some], NEIGHBOURS)[1])]
    centred = near - near.mean(axis=1, keepdims=True)
    least = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", centred, centred))[:, 0]
    return float(np.sqrt(np.quantile(np.maximum(least, 0.0) / (NEIGHBOURS - 3), 0.25)))


def noisier(survey: Survey, times: float) -> Survey:
    """Heights with so many times the noise."""
    more = measured_noise(survey) * np.sqrt(times**2 - 1.0)
    shift = rng_of(survey, "heights").normal(0.0, more, len(survey.xyz))
    return replace(survey, xyz=survey.xyz + np.column_stack([0 * shift, 0 * shift, shift]))


def shifted_strips(survey: Survey, metres: float) -> Survey:
    """Every second strip moved sideways and up by so much; one strip alone stays as it is."""
    odd = np.unique(survey.strip, return_inverse=True)[1].reshape(-1) % 2
    return replace(survey, xyz=survey.xyz + odd[:, None] * np.array([metres, 0.0, metres]))


def gaps(survey: Survey, width: float = 3.0, every: float = 40.0) -> Survey:
    """Bands without points, as between strips that do not overlap."""
    return survey.take(np.mod(survey.xyz[:, 0] - survey.xyz[:, 0].min() - every / 2, every) > width)


def turned(survey: Survey, degrees: float = 17.0) -> Survey:
    """The survey turned about its middle."""
    angle, middle = np.radians(degrees), np.round(survey.xyz[:, :2].mean(axis=0))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    xy = (survey.xyz[:, :2] - middle) @ turn + middle
    return replace(survey, xyz=np.column_stack([xy, survey.xyz[:, 2]]))


def mirrored(survey: Survey) -> Survey:
    """East and west exchanged."""
    west, east = survey.xyz[:, 0].min(), survey.xyz[:, 0].max()
    x = np.round(west + east) - survey.xyz[:, 0]
    return replace(survey, xyz=np.column_stack([x, survey.xyz[:, 1:]]))


def raised(survey: Survey, metres: float = 1500.0) -> Survey:
    """The same place high up."""
    return replace(survey, xyz=survey.xyz + [0.0, 0.0, metres])


def one_strip(survey: Survey) -> Survey:
    """The strip with the most points."""
    numbers, count = np.unique(survey.strip, return_counts=True)
    return survey.take(survey.strip == numbers[np.argmax(count)])


VARIANTS: dict[str, Callable[[Survey], Survey]] = {
    WHOLE: lambda survey: survey,
    "echoes 50 %": lambda survey: few_echoes(survey, 0.5),
    "echoes 15 %": lambda survey: few_echoes(survey, 0.15),
    "echoes 5 %": lambda survey: few_echoes(survey, 0.05),
    "echoes 0 %": lambda survey: few_echoes(survey, 0.0),
    "first returns": first_returns,
    "last returns": last_returns,
    "no return fields": no_fields,
    "density 1/2": lambda survey: thinned(survey, 0.5),
    "density 1/4": lambda survey: thinned(survey, 0.25),
    "density 1/10": lambda survey: thinned(survey, 0.1),
    "noise x2": lambda survey: noisier(survey, 2.0),
    "noise x3": lambda survey: noisier(survey, 3.0),
    "strips 5 cm apart": lambda survey: shifted_strips(survey, 0.05),
    "strips 10 cm apart": lambda survey: shifted_strips(survey, 0.10),
    "gaps": gaps,
    "turned": turned,
    "mirrored": mirrored,
    "heights in feet": lambda survey: replace(survey, height_unit=FOOT_M),
    "1500 m up": raised,
    "one strip": one_strip,
}
"""Every transformation by name; each leaves every point's class as it is."""


def applies(variant: str, survey: Survey) -> bool:
    """Whether a variant is another survey at all: strips need strips, echoes need returns."""
    strips = len(np.unique(survey.strip))
    echoes = survey.returns is not None and bool((survey.returns > 1).any())
    if variant in ("strips 5 cm apart", "strips 10 cm apart", "one strip"):
        return strips > 1
    if variant.startswith("echoes") or variant in ("first returns", "last returns", "no return fields"):
        return echoes
    return True


def labelled_surveys(data: Path) -> dict[str, Callable[[], Survey]]:
    """Every survey with class 6 or at least known ground, or with no building at all, by name."""

    def files(name: str, pattern: str, epsg: int | None) -> Callable[[], Survey]:
        return lambda: read_survey(name, sorted(data.glob(pattern)), epsg)

    return {
        "delft": files("delft", "delft/ahn3.laz", 28992),
        "delft_small": files("delft_small", "misc/delft_small.laz", 28992),
        "amsterdam": files("amsterdam", "ahn3_ground/Amsterdam*.las", 28992),
        "biesbosch": files("biesbosch", "ahn3_ground/Biesbosch*.las", 28992),
        "ign_urban": files("ign_urban", "ign_urban/*.laz", 2154),
        "ign_sparse": files("ign_sparse", "ign_sparse/*.laz", 2154),
        "ign_buildings": files("ign_buildings", "ign_buildings/*postValidation.laz", 2154),
        "conifer": files("conifer", "misc/lidR_MixedConifer.laz", 32612),
        "topography": files("topography", "misc/lidR_Topography.laz", 26917),
        "galapagos": files("galapagos", "galapagos/galapagos.laz", 32715),
        "california": files("california", "california/*.la[sz]", 26910),
    }


PLACES = {"delft_small": "delft"}
"""Surveys of one place: they are left out together."""
NOT_JUDGED = {"ign_buildings": (208, 214), "ign_sparse": (65, 67), "california": (0, 1)}
"""Classes that a survey's maker left undecided."""


def judged(survey: Survey) -> Mask:
    """The points (N,) whose class is known."""
    return np.asarray(~np.isin(survey.truth, NOT_JUDGED.get(survey.name, ())), np.bool_)
