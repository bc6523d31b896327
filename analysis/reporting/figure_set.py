"""All figures of one trial with their captions, in the order of the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from analysis.reporting import cloud_figures, figures
from analysis.reporting import style as look
from analysis.reporting.clouds import clouds_of
from analysis.reporting.trial_report import TrialReport


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
    "rotation_cloud": "Recorded point cloud of rotations (rotation vectors from the first end point, world "
    "frame) with the "
    "end points highlighted; below, the end points alone, numbered in cycle order.",
    "sphere": "Where the object's x, y and z axes pointed during the trial, on the unit sphere of the world frame, "
    "with the end points highlighted; below, the end points alone, numbered, seen from outside. A perfect hand "
    "would put all end points of one axis on the same spot.",
    "translation_cloud": "Recorded point cloud of positions with the end points highlighted and numbered.",
    "rotation": "Rotation about the motion axis over time. One end point per cycle, always at the same phase; what "
    "lies before the first and after the last one does not count.",
    "steps": "How far the object turned from one end point to the next. θ̄ is the angle of the average of these "
    "rotations; "
    "it is below the bars where they do not all turn the same way.",
    "drift": "Path of the end points, seen along the axis about which they wander least.",
    "sensitivity": "θ̄ as the card says, and what it would have been with other choices. To first order only the "
    "first and "
    "the last end point matter, so leaving one out shows how firm the score is.",
    "link": "Time between neighbouring samples, with the places where samples are missing.",
}
"""Caption of every figure, in the order of the report."""


def draw_figures(trial: TrialReport, formats: tuple[str, ...] = look.FORMATS) -> tuple[NamedFigure, ...]:
    """Draw every figure a trial has.

    Parameters
    ----------
    trial
        What to draw.
    formats
        Which files to make of each.

    Returns
    -------
    In the order of ``CAPTIONS``; figures without data are left out.
    """
    drawn = []
    for name in CAPTIONS:
        with look.style():
            figure = make_figure(trial, name)
        if figure is not None:
            files = {kind: look.figure_bytes(figure, kind) for kind in formats}
            drawn.append(NamedFigure(name, caption(trial, name), files))
    return tuple(drawn)


def caption(trial: TrialReport, name: str) -> str:
    """Say what a figure shows; of end points that make no score, that too.

    Parameters
    ----------
    trial
        What is drawn.
    name
        One of ``CAPTIONS``.
    """
    doubtful = not trial.view.valid and name != "link"
    return CAPTIONS[name] + (" No score is claimed: these end points are only what was found." if doubtful else "")


def make_figure(trial: TrialReport, name: str) -> look.PaperFigure | None:
    """Make one figure; call inside :func:`analysis.reporting.style.style`.

    Parameters
    ----------
    trial
        What to draw.
    name
        One of ``CAPTIONS``.

    Returns
    -------
    The figure, or None where the trial has nothing to show in it.
    """
    series, result = trial.series, trial.result
    enough = len(trial.view.steps_deg) > 0
    makers: dict[str, Callable[[], look.PaperFigure | None]] = {
        "rotation_cloud": lambda: cloud_figures.rotation_cloud_figure(clouds_of(series, result)),
        "sphere": lambda: cloud_figures.sphere_figure(clouds_of(series, result)),
        "translation_cloud": lambda: cloud_figures.translation_cloud_figure(clouds_of(series, result)),
        "rotation": lambda: figures.rotation_figure(series, result),
        "steps": lambda: figures.steps_figure(result) if enough else None,
        "drift": lambda: figures.drift_figure(result) if enough else None,
        "sensitivity": lambda: figures.sensitivity_figure(result) if trial.view.sensitivity() else None,
        "link": lambda: figures.link_figure(series, trial.losses) if series.times_measured else None,
    }
    return makers[name]()
