"""An operator's session on nine roofs: what each action does, and that Save gives the files of an update."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
import shapely.affinity
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from eaves.edit.actions import OF_ROOF, TOOLS, ActionError, Session
from eaves.edit.review import summarise
from eaves.flow import Edit, StatedFace, read_edits
from eaves.flow.edits import write_edits
from eaves.formats import InputError, read_polygons
from eaves.pipeline import build
from eaves.simulate import nine_roofs_on_a_slope, write_simulation
from eaves.upkeep.update import update
from eaves.validate import validate_file
from tests.conftest import but_first

WRITTEN = ("footprints.gpkg", "buildings.city.jsonl", "classified.laz", "review.csv", "dsm.tif", "edits.gpkg")


def corners(polygon: shapely.Polygon) -> list[list[float]]:
    """The corners of an outline."""
    return [[float(x), float(y)] for x, y in polygon.exterior.coords[:-1]]


def crossing(polygon: shapely.Polygon) -> list[list[float]]:
    """A line from west to east through the middle of an outline."""
    west, south, east, north = polygon.bounds
    middle = (south + north) / 2.0
    return [[west - 1.0, middle], [east + 1.0, middle]]


def values(session: Session, name: str) -> dict[str, Any]:
    """What tables say of a building."""
    saved = session.trial.buildings([name])[name]
    assert saved is not None
    return dict(saved.row.values)


@pytest.fixture
def one_moment() -> Iterator[None]:
    """GeoPackages say when they were written: always the same."""
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": "2026-01-01T00:00:00.000Z"})
    yield
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": None})


def files_of(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in WRITTEN if (folder / name).exists()}


def updated(kept: Path, place: Path, edits: Path) -> dict[str, bytes]:
    """The files of `eaves update` with edits, of a copy of the run."""
    shutil.copytree(kept, place)
    copied = place.parent / "edits.gpkg"
    shutil.copy(edits, copied)
    update(place, edits=copied)
    return files_of(place)


def test_a_corner_is_moved__undone_and_done_again(session: Session) -> None:
    name, outline = next(iter(session.outlines.items()))
    x, y = corners(outline)[0]
    change = session.act({"do": "move", "id": name, "moves": [[[x, y], [x - 0.5, y - 0.5]]]})
    assert list(change.buildings) == [name]
    assert values(session, name)["trust"] == "manual"
    assert session.outlines[name].area > outline.area
    assert len(read_edits(session.folder / "edits.gpkg", session.trial.system)) == 1
    session.undo()
    assert session.outlines[name].equals(outline)
    assert read_edits(session.folder / "edits.gpkg", session.trial.system) == []
    session.redo()
    assert session.outlines[name].area > outline.area
    with pytest.raises(ActionError, match="nothing to redo"):
        session.redo()


def test_a_building_is_split__its_parts_edited__and_joined_again(session: Session) -> None:
    name, outline = next(iter(session.outlines.items()))
    session.act({"do": "split", "id": name, "line": crossing(outline)})
    second = f"{name}-2"
    assert session.outlines[name].area + session.outlines[second].area == pytest.approx(
        outline.area, abs=0.05
    )
    session.act({"do": "state", "id": second, "verdict": "flat roof"})
    assert values(session, second)["roof_type"] == "flat"
    assert "flat" not in values(session, name)["edit"]
    session.act({"do": "join", "ids": [name, second]})
    assert second not in session.outlines
    assert session.outlines[name].area == pytest.approx(outline.area, abs=0.05)


def test_heights_are_those_typed(session: Session) -> None:
    name = next(iter(session.outlines))
    before = values(session, name)
    session.act({"do": "state", "id": name, "verdict": "base height", "value": before["h_ground"] - 1.0})
    session.act({"do": "state", "id": name, "verdict": "eaves height", "value": before["h_eaves"] + 2.0})
    after = values(session, name)
    assert after["h_ground"] == pytest.approx(before["h_ground"] - 1.0, abs=0.01)
    assert after["h_eaves"] == pytest.approx(before["h_eaves"] + 2.0, abs=0.05)


def test_a_gable_and_a_hip_are_those_of_moments(session: Session) -> None:
    rows = {name: values(session, name) for name in session.outlines}
    hip = next(name for name, row in rows.items() if row["roof_type"] == "hip")
    session.act({"do": "state", "id": hip, "verdict": "gable roof"})
    assert values(session, hip)["house_type"] == "gable"
    session.act({"do": "state", "id": hip, "verdict": "hip roof"})
    assert values(session, hip)["house_type"] == "hip"
    session.act({"do": "state", "id": hip, "verdict": "roof of points"})
    assert values(session, hip)["method"] == rows[hip]["method"]


def faces_of(session: Session, kind: str) -> tuple[str, list[StatedFace]]:
    """The building with a roof of a kind, and its faces."""
    name = next(one for one in session.outlines if values(session, one)["roof_type"] == kind)
    return name, session.trial.faces(name)


def top_line(faces: list[StatedFace]) -> np.ndarray[Any, Any]:
    """The ends (2, 2) of the ridge, where both long faces of a roof have their highest corners."""
    pair = sorted(faces, key=lambda face: -face.polygon.area)[:2]
    places = shapely.get_coordinates(pair[0].polygon)[:-1]
    return places[np.argsort(-pair[0].height_at(places))[:2]]


def moved_ridge(faces: list[StatedFace], aside: float) -> tuple[Any, Any]:
    """The ends (2, 2) of the ridge, and where a move aside (m) takes them."""
    ends = top_line(faces)
    way = ends[1] - ends[0]
    return ends, ends + aside * np.array([-way[1], way[0]]) / np.hypot(*way)


@pytest.mark.parametrize("kind", ["gable", "hip"])
def test_a_ridge_is_where_it_is_moved__with_the_eaves_and_hips_as_they_were(
    session: Session, kind: str
) -> None:
    name, faces = faces_of(session, kind)
    (ends, moved), before = moved_ridge(faces, 0.8), values(session, name)
    height = max(faces, key=lambda face: face.polygon.area).height_at(ends).max()
    action = {"do": "ridge", "id": name, "line": ends.tolist(), "to": moved[0].tolist(), "rise": 0.5}
    session.act(action)
    after, now = values(session, name), session.trial.faces(name)
    middle = moved.mean(axis=0)
    near = [face for face in now if face.polygon.distance(shapely.Point(middle)) < 0.01]
    assert len(near) == 2
    assert [face.height_at(middle[None])[0] for face in near] == pytest.approx([height + 0.5] * 2, abs=0.03)
    assert after["h_eaves"] == pytest.approx(before["h_eaves"], abs=0.03)
    assert (after["roof_type"], after["edit"], after["trust"]) == (kind, "roof face", "manual")
    assert len(now) == len(faces)
    with pytest.raises(ActionError, match="beyond its faces"):
        session.act({**action, "line": moved.tolist(), "to": (ends + 9.0 * (moved - ends))[0].tolist()})


def test_two_faces_made_one_have_the_plane_of_the_points_of_both(session: Session) -> None:
    name, faces = faces_of(session, "gable")
    places = [list(face.polygon.representative_point().coords[0]) for face in faces[:2]]
    session.act({"do": "unite", "id": name, "at": places})
    (one,) = session.trial.faces(name)
    assert one.polygon.area == pytest.approx(session.outlines[name].area, abs=0.1)
    assert np.hypot(*one.rise) < 0.05  # a gable of two alike slopes has a level plane in the middle
    with pytest.raises(ActionError, match="not in two faces"):
        session.act({"do": "unite", "id": name, "at": places})


def test_a_face_that_is_drawn_has_the_plane_of_its_points__and_goes_with_another_roof(
    session: Session,
) -> None:
    name, faces = faces_of(session, "flat")
    outline = session.outlines[name]
    (x, y), half = outline.centroid.coords[0], 1.5
    plan = corners(shapely.box(x - half, y - half, x + half, y + half))
    session.act({"do": "face", "id": name, "plan": plan})
    now = session.trial.faces(name)
    drawn = min(now, key=lambda face: abs(face.polygon.area - 9.0))
    assert drawn.polygon.symmetric_difference(shapely.Polygon(plan)).area < 0.1
    assert drawn.height_at(np.array([[x, y]]))[0] == pytest.approx(
        faces[0].height_at(np.array([[x, y]]))[0], abs=0.05
    )
    session.act({"do": "state", "id": name, "verdict": "eaves height", "value": 30.0})
    raised = min(
        session.trial.faces(name), key=lambda face: face.polygon.symmetric_difference(drawn.polygon).area
    )
    assert raised.height_at(np.array([[x, y]]))[0] == pytest.approx(30.0, abs=0.05)
    session.act({"do": "state", "id": name, "verdict": "roof of points"})
    assert len(session.trial.faces(name)) == len(faces)
    assert values(session, name)["h_eaves"] == pytest.approx(30.0, abs=0.05)


def test_a_roof_under_its_base_is_refused__and_nothing_kept(session: Session) -> None:
    name, faces = faces_of(session, "gable")
    places = [list(face.polygon.representative_point().coords[0]) for face in faces[:2]]
    session.act({"do": "unite", "id": name, "at": places})
    with pytest.raises(ActionError, match="the stated roof has"):
        session.act({"do": "state", "id": name, "verdict": "eaves height", "value": 1.0})
    assert len(read_edits(session.folder / "edits.gpkg", session.trial.system)) == 1
    assert len(session.trial.faces(name)) == 1


def test_a_missing_building_is_drawn__and_deleted(session: Session) -> None:
    name, outline = next(iter(session.outlines.items()))
    session.act({"do": "delete", "id": name})
    assert name not in session.outlines
    change = session.act({"do": "draw", "plan": corners(outline)})
    assert list(change.buildings) == [name]  # it is the one that was found there
    session.undo()
    session.undo()
    assert session.outlines[name].equals(outline)


def test_what_was_looked_at_is_kept__and_told_by_reason(session: Session, out: Path) -> None:
    name = next(iter(session.outlines))
    session.act({"do": "right", "id": name})
    session.save()
    _, _, rows, _ = read_polygons(out / "footprints.gpkg", "footprints")
    row = next(row for row in rows if row["id"] == name)
    assert (row["edit"], row["trust"], row["reviewed"]) == ("right", "manual", session.day)
    assert name not in (out / "review.csv").read_text(encoding="utf-8")
    square = shapely.box(0, 0, 9, 9)
    told = summarise(
        [Edit("right", square, "a", reason="x 5%"), Edit("footprint", square, "b", reason="x 7%; y")]
    )
    assert "1 of    2 edited: x …" in told and "1 of    1 edited: y" in told


def test_edits_survive_a_killed_session__and_those_of_another_program_are_taken_in(out: Path) -> None:
    with closing(Session(out)) as first:
        names = list(first.outlines)
        first.act({"do": "delete", "id": names[0]})
    with closing(Session(out)) as second:
        assert names[0] not in second.outlines
        edits = read_edits(out / "edits.gpkg", second.trial.system)
        more = Edit("no building", second.outlines[names[1]], names[1], "qgis")
        write_edits(out / "edits.gpkg", [*edits, more], second.trial.system)
        assert dict.fromkeys([names[1]]) == second.take_in().buildings
        second.undo()
        assert names[0] in second.outlines and names[1] not in second.outlines


def test_a_second_session_is_told_who_holds_the_folder(session: Session, out: Path) -> None:
    with pytest.raises(InputError, match=r"another run is writing here and holds .*process \d+, since"):
        Session(out)


@pytest.mark.parametrize(
    ("action", "reason"),
    [
        ({"do": "split", "line": [[0, 0], [1, 1]]}, "does not cross"),
        ({"do": "outline", "plan": [[0, 0], [9, 9], [9, 0], [0, 9]]}, "crosses itself"),
        ({"do": "outline", "plan": [[0, 0], [0.1, 0], [0, 0.1]]}, "less than 1"),
        ({"do": "draw", "plan": [[9e5, 0], [9e5 + 9, 0], [9e5, 9]]}, "more than 300 m"),
        ({"do": "state", "verdict": "eaves height", "value": "high"}, "no number"),
        ({"do": "move", "moves": [[[0, 0], [1, float("nan")]]]}, "not two numbers"),
        ({"do": "sing"}, "'do' is none of"),
        ({"do": "unite", "at": [[0, 0], [1, 1]]}, "not in two faces"),
        ({"do": "ridge", "line": [[0, 0], [9, 0]], "to": [0, 1]}, "no two planes meet"),
        ({"do": "face", "plan": [[0, 0], [9, 0], [9, 9]]}, "less than 1"),
        ([], "a JSON object"),
    ],
)
def test_what_cannot_be_is_refused__and_nothing_written(session: Session, action: Any, reason: str) -> None:
    if isinstance(action, dict):
        action["id"] = next(iter(session.outlines))
    with pytest.raises(ActionError, match=reason):
        session.act(action)
    assert not (session.folder / "edits.gpkg").exists()


def any_action(choose: Random, session: Session) -> dict[str, Any]:
    """An action on buildings as they are."""
    outlines = session.outlines
    name = choose.choice(sorted(outlines))
    outline, kind = outlines[name], choose.choice(sorted(TOOLS))
    a, b, c, d = (choose.uniform(-1.5, 1.5) for _ in range(4))
    if kind == "move":
        (x, y), (u, v) = choose.sample(corners(outline), 2)
        return {"do": kind, "id": name, "moves": [[[x, y], [x + a, y + b]], [[u, v], [u + c, v + d]]]}
    if kind == "outline":
        return {"do": kind, "id": name, "plan": corners(shapely.affinity.translate(outline, a, b))}
    if kind == "split":
        (west, y), (east, _) = crossing(outline)
        return {"do": kind, "id": name, "line": [[west, y + a], [east, y + b]]}
    if kind == "join":
        other = min((one for one in outlines if one != name), key=lambda one: outlines[one].distance(outline))
        return {"do": kind, "ids": [name, other]}
    if kind == "draw":
        east, north = outline.bounds[2] + 3.0 + a, outline.bounds[3] - 5.0 + b
        return {"do": kind, "plan": corners(shapely.box(east, north, east + 5.0 + c, north + 6.0 + d))}
    x, y = outline.representative_point().coords[0]
    if kind == "face":
        plan = shapely.affinity.rotate(
            shapely.box(x + a - 1.6, y + b - 1.6, x + c + 1.6, y + d + 1.6), 30.0 * a
        )
        return {"do": kind, "id": name, "plan": corners(plan)}
    faces = session.trial.faces(name)
    if kind == "unite" and len(faces) > 1:
        places = [list(face.polygon.representative_point().coords[0]) for face in choose.sample(faces, 2)]
        return {"do": kind, "id": name, "at": places}
    if kind == "ridge" and len(faces) > 1:
        ends, moved = moved_ridge(faces, a)
        return {"do": kind, "id": name, "line": ends.tolist(), "to": moved[0].tolist(), "rise": b}
    value = choose.uniform(12.0, 32.0)
    return {"do": "state", "id": name, "verdict": choose.choice(OF_ROOF), "value": value}


@pytest.mark.parametrize("count", but_first([6, 200]))
def test_random_edits_leave_a_valid_town__with_the_files_of_an_update(
    kept: Path, one_moment: None, tmp_path_factory: pytest.TempPathFactory, count: int
) -> None:
    @settings(
        max_examples=1,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, 2**32))
    def session_of(seed: int) -> None:
        choose, place = Random(seed), tmp_path_factory.mktemp("random")
        shutil.copytree(kept, place / "out")
        with closing(Session(place / "out")) as session:
            for _ in range(count):
                step = choose.choice(("act", "act", "act", "act", "undo", "redo"))
                try:
                    if step == "act":
                        session.act(any_action(choose, session))
                    else:
                        getattr(session, step)()
                except ActionError:
                    pass
            session.save()
            shown = session.outlines
        assert files_of(place / "out") == updated(kept, place / "other", place / "out" / "edits.gpkg")
        assert validate_file(place / "out" / "buildings.city.jsonl") == []
        _, _, rows, _ = read_polygons(place / "out" / "footprints.gpkg", "footprints")
        assert {row["id"] for row in rows} == set(shown)

    session_of()


@pytest.mark.slow
def test_a_run_that_kept_nothing_is_edited__and_keeps_nothing(tmp_path: Path) -> None:
    files = write_simulation(nine_roofs_on_a_slope(density=4.0, seed=1), tmp_path / "nine")
    build(files["points"], tmp_path / "out", jobs=1, outputs=("footprints", "models"))
    with closing(Session(tmp_path / "out")) as session:
        assert session.trial.reached == set(), "nothing is read before it is edited"
        name = next(iter(session.outlines))
        session.act({"do": "state", "id": name, "verdict": "flat roof"})
        assert values(session, name)["roof_type"] == "flat"
        session.save()
        assert values(session, name)["roof_type"] == "flat"
    assert not [path for path in (tmp_path / "out").glob(".eaves*")]
    assert '"edit":"flat roof"' in (tmp_path / "out" / "buildings.city.jsonl").read_text(encoding="utf-8")
