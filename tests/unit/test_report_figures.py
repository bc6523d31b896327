"""Figures: the same bytes every time, in every format, from arrays that are checked against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from scipy.spatial.transform import Rotation

from analysis.reporting import style as theme
from analysis.reporting.clouds import MAX_CLOUD_POINTS, clouds_of, turn_about_axis
from analysis.reporting.figure_set import CAPTIONS, draw_figures, make_figure
from analysis.reporting.figures import _thinned, numbers_shown, sensitivity, summary_figure
from analysis.reporting.point_numbers import number_offsets
from analysis.reporting.wording import methods_text
from analysis.scoring.trial import score_series
from analysis.series import OrientationSeries
from tests.scored_trials import scored, trial_report
from tests.simulated_motion import simulate

SIGNATURES = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.fixture(scope="module")
def trial():
    return trial_report(cycles=6, slip_deg=0.0)


@pytest.fixture(scope="module")
def pictures(trial):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    drawn = draw_figures(trial, ("png",))
    assert dict(mpl.rcParams) == before  # no setting is left behind
    return drawn


def spin(degrees_total, n=2001):
    angle = np.radians(np.linspace(0, degrees_total, n))
    quats = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_quat(scalar_first=True)
    quats[::3] *= -1  # q and -q are the same
    return OrientationSeries(np.arange(n) / 100.0 + 50.0, quats, np.arange(n))


def test_every_format_is_drawn_and_the_same_input_gives_the_same_bytes(trial):
    again = {name: make_figure(trial.series, trial.result, name) for name in ("steps", "drift")}
    once = {name: make_figure(trial.series, trial.result, name) for name in ("steps", "drift")}
    for name, figure in again.items():
        for kind, signature in SIGNATURES.items():
            content = theme.figure_bytes(figure, kind)
            assert content.startswith(signature)
            assert content == theme.figure_bytes(once[name], kind), (name, kind)
            assert len(content) > 4000


def test_settings_of_the_user_change_nothing(trial, pictures):
    import matplotlib as mpl

    with mpl.rc_context({"axes.grid": True, "savefig.bbox": "tight", "image.cmap": "jet", "lines.markersize": 12}):
        assert [figure.files for figure in draw_figures(trial, ("png",))] == [figure.files for figure in pictures]


def test_a_trial_without_positions_has_all_figures_but_translation_and_no_setting_is_left_behind(pictures):
    assert [figure.name for figure in pictures] == [name for name in CAPTIONS if name != "translation_cloud"]
    assert all(figure.files["png"].startswith(b"\x89PNG") for figure in pictures)


def test_one_page_of_a_trial_and_without_a_score_the_motion_alone():
    series = simulate(cycles=6).series
    result = score_series(series)
    assert len(summary_figure(series, result, "a trial").axes) == 3
    alone = summary_figure(series, structs.replace(result, theta_bar_deg=None, valid=False), "no score\nthe reason")
    assert [axes.get_ylabel() for axes in alone.axes] == ["rotation about the\nmotion axis (°)"]
    assert alone.get_suptitle() == "no score\nthe reason"


def test_the_end_points_of_every_body_axis_are_numbered(trial):
    figure = make_figure(trial.series, trial.result, "sphere")
    panels = [ax for ax in figure.axes if ax.get_title().startswith("object ")]
    assert [ax.get_title() for ax in panels] == ["object x", "object y", "object z"]
    for number, ax in enumerate(panels):
        assert {"1", str(trial.result.n_endpoints)} <= {text.get_text() for text in ax.texts}
        # Degrees on the sphere: as far apart as the axis turned from the first to the last end point.
        points = clouds_of(trial.series, trial.result).endpoint_axes[number]
        turned = np.degrees(np.arccos(np.clip(points[0] @ points[-1], -1.0, 1.0)))
        flat = ax.lines[0].get_xydata()
        assert np.linalg.norm(flat[-1] - flat[0]) == pytest.approx(turned, rel=0.01)


def test_positions_make_a_translation_cloud_in_mm(trial):
    series = OrientationSeries(
        trial.series.times_s,
        trial.series.quats_wxyz,
        trial.series.index,
        positions_m=np.outer(trial.series.times_s, [0.001, 0.0, 0.0]),
    )
    clouds = clouds_of(series, trial.result)
    since = trial.result.endpoint_times_s - trial.result.endpoint_times_s[0]
    np.testing.assert_allclose(clouds.endpoint_positions_mm[:, 0], since, atol=1e-9)
    with theme.style():
        from analysis.reporting.cloud_figures import translation_cloud_figure

        assert translation_cloud_figure(clouds) is not None


def test_rotation_vectors_are_continuous_beyond_half_a_turn():
    series = spin(300.0)
    clouds = clouds_of(series, score_series(series, endpoints=[0]))
    np.testing.assert_allclose(clouds.rotvecs_deg[:, 2], np.linspace(0, 300, 2001), atol=1e-6)
    np.testing.assert_allclose(clouds.rotvecs_deg[:, :2], 0, atol=1e-9)


def test_body_axes_are_the_columns_of_the_rotation_matrix(trial):
    clouds = clouds_of(trial.series, trial.result, max_points=len(trial.series))
    matrices = Rotation.from_quat(trial.series.quats_wxyz, scalar_first=True).as_matrix()
    for number in range(3):
        np.testing.assert_allclose(clouds.axes[number], matrices[:, :, number], atol=1e-12)


def test_end_points_lie_in_their_cloud(trial):
    clouds = clouds_of(trial.series, trial.result)
    since = trial.result.endpoint_times_s - trial.series.times_s[0]
    for at, vector in zip(since, clouds.endpoint_rotvecs_deg, strict=True):
        nearest = clouds.rotvecs_deg[np.argmin(np.abs(clouds.times_s - at))]
        assert np.linalg.norm(nearest - vector) < 0.5
    assert clouds.scored.sum() == pytest.approx(len(clouds.scored) * 20 / 30, rel=0.1)


def test_turning_is_not_limited_to_half_a_turn():
    angle, axis = turn_about_axis(spin(-720.0), None)
    assert abs(angle[-1]) == pytest.approx(720.0, abs=1e-6)
    assert abs(axis[2]) == pytest.approx(1.0)


def test_large_clouds_are_thinned_but_lines_keep_their_peaks():
    n = 20_000
    series = OrientationSeries(np.arange(n) / 100, np.tile([1.0, 0, 0, 0], (n, 1)), np.arange(n))
    assert len(clouds_of(series, score_series(series)).times_s) <= MAX_CLOUD_POINTS
    values = np.zeros(n)
    values[12_345], values[777] = 5.0, -7.0
    _, kept = _thinned(series.times_s, values, 1000)
    assert (kept.max(), kept.min()) == (5.0, -7.0)
    assert len(kept) <= 1000


@pytest.mark.parametrize(("n", "most"), [(0, 5), (1, 5), (5, 5), (6, 5), (97, 20), (1000, 12)])
def test_numbers_always_name_the_first_and_the_last(n, most):
    shown = numbers_shown(n, most)
    assert len(shown) <= most + 1
    assert shown == sorted(set(shown))
    if n:
        assert shown[0] == 0
        assert shown[-1] == n - 1


def test_a_result_without_a_score_is_drawn_without_inventing_one():
    series, _ = scored(cycles=6)
    result = score_series(series, endpoints=[])
    assert not result.valid
    trial = trial_report(cycles=6)
    empty = replace(trial, series=series, result=result)
    assert {figure.name for figure in draw_figures(empty, ("png",))} == {"rotation_cloud", "sphere", "rotation", "link"}
    assert sensitivity(result) == []


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), max_size=25), st.sampled_from((1e-3, 1.0, 20.0, 100.0)))
@settings(max_examples=30, deadline=None)
def test_numbers_cover_no_point_and_no_other_number(points, spread):
    points = spread * np.array(points).reshape(-1, 2)
    corners = np.array(((-60.0, -60.0), (60.0, 60.0)))
    found = number_offsets(np.clip(points, -45, 45), corners, 6.0)
    assert {0, len(points) - 1} <= set(found) or not len(points)
    boxes = []
    for number, offset in found.items():
        middle = np.clip(points, -45, 45)[number] + offset
        half = np.array((0.33 * 6.0 * len(str(number + 1)), 0.4 * 6.0))
        assert (middle - half >= corners[0]).all()
        assert (middle + half <= corners[1]).all()
        if number not in {0, len(points) - 1}:  # these two stand there whatever they cover
            assert not (np.abs(np.clip(points, -45, 45) - middle) < half).all(axis=1).any()
            assert not any((np.abs(middle - at) < half + other).all() for at, other in boxes)
        boxes.append((middle, half))


def test_without_time_stamps_nothing_is_reported_of_missing_samples(trial):
    unmeasured = replace(trial, series=replace(trial.series, times_measured=False))
    assert make_figure(unmeasured.series, unmeasured.result, "link") is None
    assert "no time stamps" in methods_text(unmeasured)
    assert "no time stamps" not in methods_text(trial)


def test_characters_without_a_glyph_become_visible_marks():
    assert theme.drawable("θ̄ ° ok") == "θ̄ ° ok"
    assert theme.drawable("\x1b[31m漢") == "\ufffd[31m\ufffd"
