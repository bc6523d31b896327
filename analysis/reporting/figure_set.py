"""All figures of one trial with their captions, in the order of the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from analysis.reporting import cloud_figures, figures, style
from analysis.reporting.clouds import clouds_of
from analysis.reporting.trial_report import TrialReport
from analysis.scoring.result import Result
from analysis.series import OrientationSeries


@dataclass(frozen=True)
class NamedFigure:
    """One figure as files."""

    name: str
    """Stem of the file."""
    caption: str
    """What is to be seen, for a stranger."""
    files: dict[str, bytes]
    """Content by format."""


CAPTIONS = {
    "rotation_cloud": "Recorded point cloud of rotations (rotation vectors from the first end point, world frame) "
    "with the end points highlighted; below, the end points alone, numbered in cycle order.",
    "sphere": "Where the object's x, y and z axes pointed during the trial, on the unit sphere of the world frame, "
    "with the end points highlighted; below, the end points alone, numbered, seen from outside. A perfect hand "
    "would put all end points of one axis on the same spot.",
    "translation_cloud": "Recorded point cloud of positions with the end points highlighted and numbered.",
    "rotation": "Rotation about the motion axis over time. One end point per cycle, always at the same phase; what "
    "lies before the first and after the last one does not count.",
    "steps": "How far the object turned from one end point to the next. θ̄ is the angle of the average of these "
    "rotations; it is below the bars where they do not all turn the same way.",
    "drift": "Path of the end points, seen along the axis about which they wander least.",
    "sensitivity": "θ̄ by the card, and what it would have been with other choices. To first order only the "
    "first and the last end point matter, so leaving one out shows how firm the score is.",
    "link": "Time between neighbouring samples, with the places where samples are missing.",
}
"""Caption of every figure, in the order of the report."""


def draw_figures(trial: TrialReport, formats: tuple[str, ...] = style.FORMATS) -> tuple[NamedFigure, ...]:
    """Return every figure that a trial has, in the order of ``CAPTIONS``; figures without data are left out."""
    doubt = "" if trial.result.valid else " No score is claimed: these end points are only what was found."
    drawn = []
    for name, caption in CAPTIONS.items():
        figure = make_figure(trial.series, trial.result, name)
        if figure is not None:
            files = {kind: style.figure_bytes(figure, kind) for kind in formats}
            drawn.append(NamedFigure(name, caption + (doubt if name != "link" else ""), files))
    return tuple(drawn)


@style.style()
def make_figure(series: OrientationSeries, result: Result, name: str) -> style.PaperFigure | None:
    """Return one figure of ``CAPTIONS``; None where there is nothing to show in it.

    Raises
    ------
    ValueError
        Another name.
    """
    scored = bool(result.steps_deg)
    makers: dict[str, Callable[[], style.PaperFigure | None]] = {
        "rotation_cloud": lambda: cloud_figures.rotation_cloud_figure(clouds_of(series, result)),
        "sphere": lambda: cloud_figures.sphere_figure(clouds_of(series, result)),
        "translation_cloud": lambda: cloud_figures.translation_cloud_figure(clouds_of(series, result)),
        "rotation": lambda: _column(2.1, figures.draw_rotation, series, result),
        "steps": lambda: _column(1.9, figures.draw_steps, result) if scored else None,
        "drift": lambda: figures.drift_figure(result) if scored else None,
        "sensitivity": lambda: (
            _column(figures.sensitivity_height_in(result), figures.draw_sensitivity, result) if scored else None
        ),
        "link": lambda: figures.link_figure(series, result.losses) if series.times_measured else None,
    }
    if name not in makers:
        raise ValueError(f"there is no figure {name!r}; there are {', '.join(makers)}")
    return makers[name]()


def _column(height_in: float, draw: Callable[..., None], *args: object) -> style.PaperFigure:
    figure = style.new_figure(height_in)
    draw(figure, *args)
    return figure
