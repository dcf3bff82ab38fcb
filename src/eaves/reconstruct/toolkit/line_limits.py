"""What the candidate lines of a plan are found by, and what levels stand for clutter: declared once."""

from __future__ import annotations

from dataclasses import dataclass

from eaves.methods import parameter
from eaves.reconstruct.stage import Reconstructor


@dataclass(frozen=True)
class LineLimits:
    """What makes a candidate line; parameters of `LineReconstructor`, which says what each means."""

    wide_gap: float
    least_weight: float
    strip_width: float
    main_weight: float
    least_fall: float
    meeting_jump: float
    rectangle_points: int
    rectangle_trim: float
    rectangle_filling: float
    same_line: float
    shortest_edge: float


@dataclass(frozen=True)
class ClutterLimits:
    """What makes a level of points without a plane; parameters of `LineReconstructor`."""

    points: int
    area: float
    reach: float
    step: float


class LineReconstructor(Reconstructor):
    """A reconstructor whose plan is cut by candidate lines.

    Examples
    --------
    >>> import eaves
    >>> eaves.Arrangement().line_limits().meeting_jump
    0.25
    """

    wide_gap: float = parameter(
        2.0, "Neighbours further apart than this many spacings have a shadow between them.", gt=0.0
    )
    least_weight: float = parameter(
        0.15,
        "Weight of a border place where heights do not differ; one of a metre or more weighs 1.",
        ge=0.0,
        le=1.0,
    )
    strip_width: float = parameter(
        1.2, "Width, in spacings, of the strip in which border places make one line.", gt=0.0
    )
    main_weight: float = parameter(
        1.3, "How much more a line along the footprint is trusted than one along a plane's fall.", gt=0.0
    )
    least_fall: float = parameter(
        0.1, "Rise per metre below which a plane has no direction worth following.", ge=0.0
    )
    meeting_jump: float = parameter(
        0.25,
        "Two planes meet where their heights at the border between their points differ by less.",
        unit="m",
        ge=0.0,
    )
    rectangle_points: int = parameter(6, "Fewest points of a plane whose rectangle is worth drawing.", ge=1)
    rectangle_trim: float = parameter(
        2.0,
        "Percentage of a plane's points, on each side, that its rectangle leaves out.",
        unit="percent",
        ge=0.0,
        lt=50.0,
    )
    rectangle_filling: float = parameter(
        0.7, "Share of its rectangle that a plane's points fill when it is one.", ge=0.0, le=1.0
    )
    same_line: float = parameter(
        0.2,
        "Parallel lines nearer than this, or than half the spacing, are one: eaves overhang walls by more.",
        unit="m",
        ge=0.0,
    )
    shortest_edge: float = parameter(
        0.3, "Shorter footprint edges have no direction to align with.", unit="m", ge=0.0
    )
    clutter_points: int = parameter(6, "Fewest points that make a level of what no plane explains.", ge=1)
    clutter_area: float = parameter(
        1.0, "Least area that makes a level of what no plane explains.", unit="m2", ge=0.0
    )
    clutter_reach: float = parameter(
        2.0, "Points without a plane that are this many spacings apart stand together.", gt=0.0
    )
    clutter_step: float = parameter(
        0.5, "They stand together only when their heights differ by less.", unit="m", gt=0.0
    )

    def line_limits(self) -> LineLimits:
        """What makes a candidate line."""
        return LineLimits(
            wide_gap=self.wide_gap,
            least_weight=self.least_weight,
            strip_width=self.strip_width,
            main_weight=self.main_weight,
            least_fall=self.least_fall,
            meeting_jump=self.meeting_jump,
            rectangle_points=self.rectangle_points,
            rectangle_trim=self.rectangle_trim,
            rectangle_filling=self.rectangle_filling,
            same_line=self.same_line,
            shortest_edge=self.shortest_edge,
        )

    def clutter_limits(self) -> ClutterLimits:
        """What makes a level of points without a plane."""
        return ClutterLimits(self.clutter_points, self.clutter_area, self.clutter_reach, self.clutter_step)
