"""Comparison: what may stand in one table, which differences count, tables, forest plot and site."""

import csv
import html.parser
import io
import json
from typing import ClassVar

import matplotlib.text
import numpy as np
import pytest

from analysis.reporting import style as theme
from analysis.reporting.comparison import ComparedSource, ComparisonError, compare, difference_text, forest_figure
from analysis.reporting.site import comparison_html, site_files
from analysis.reporting.tables import TrialFigure, pool, summary_csv, summary_latex, summary_markdown
from analysis.scoring.result import result_text
from host.cli import main
from host.submission.bundle import bundle_bytes, read_bundle

RULES = (("card", "V1.0"), ("score version", "1"))


def trial(hand, theta, ends=None, thing="cube", motion="roll"):
    return TrialFigure(hand, thing, motion, theta, ends)


def source(name, *trials, rules=RULES, note="", unverified=""):
    return ComparedSource(name, rules, trials, note, unverified)


def test_the_interval_of_repeats_is_the_t_interval_of_their_mean():
    (row,) = pool([trial("A", theta, (0.0, 9.0)) for theta in (1.0, 2.0, 3.0)])
    half = 4.302652729911275 * 1.0 / 3**0.5  # Student's t, 2 degrees of freedom, from tables
    assert row.theta_bar_mean_deg == pytest.approx(2.0)
    assert row.interval_deg == pytest.approx((max(0.0, 2.0 - half), 2.0 + half))
    assert (row.n_valid, row.theta_bar_min_deg, row.theta_bar_max_deg, row.interval_kind) == (
        3,
        1.0,
        3.0,
        "between trials",
    )


def test_trials_without_score_are_counted_and_not_averaged():
    (row,) = pool([trial("A", 1.0, (0.5, 1.5)), trial("A", None)])
    assert (row.theta_bar_mean_deg, row.n_valid, row.n_trials, row.interval_deg) == (1.0, 1, 2, (0.5, 1.5))
    (row,) = pool([trial("A", None)])
    assert (row.theta_bar_mean_deg, row.interval_kind) == (None, "none")


def test_only_differences_beyond_their_uncertainty_are_called_larger():
    found = compare(
        [source("s", trial("A", 1.0, (0.7, 1.3)), trial("B", 2.0, (1.6, 2.4)), trial("C", 1.2, (0.8, 1.6)))]
    )
    verdicts = {(d.one, d.other): (d.larger, d.uncertainty_deg) for d in found.differences}
    assert verdicts["B", "A"] == (True, pytest.approx(0.5))
    assert verdicts["C", "A"][0] is False
    assert verdicts["B", "C"] == (True, pytest.approx(0.32**0.5))
    assert "within the uncertainty" in "".join(map(difference_text, found.differences))
    unknown = compare([source("s", trial("A", 1.0), trial("B", 5.0))]).differences[0]
    assert unknown.larger is None
    assert "not known" in difference_text(unknown)


def test_an_interval_that_touches_zero_is_put_into_words():
    found = compare([source("s", trial("A", 1.0, (0.0, 2.3)), trial("B", 2.0, (1.6, 2.4)))])
    (note,) = found.notes
    assert "A" in note
    assert note.endswith("cannot be distinguished from no drift: its interval touches 0")


@pytest.mark.parametrize("counts", [(2, 2), (3, 8), (5, 5), (12, 4), (2, 30)])
def test_a_difference_is_judged_no_bolder_than_by_welch(counts):
    from scipy import stats

    rng = np.random.default_rng(counts[0] * 100 + counts[1])
    for scale in (0.05, 0.4):
        repeats = [
            rng.normal(mean, spread, n) for mean, spread, n in zip((9.0, 5.0), (scale, 0.2), counts, strict=True)
        ]
        trials = [trial(hand, float(value)) for hand, values in zip("AB", repeats, strict=True) for value in values]
        (found,) = compare([source("s", *trials)]).differences
        welch = stats.ttest_ind(*repeats, equal_var=False).confidence_interval(0.95)
        assert found.difference_deg == pytest.approx(repeats[0].mean() - repeats[1].mean())
        assert found.uncertainty_deg >= 0.5 * (welch.high - welch.low) * (1 - 1e-12)
        halves = [stats.t.ppf(0.975, len(r) - 1) * stats.sem(r) for r in repeats]
        # The lower end is cut at 0, the uncertainty is not.
        assert found.uncertainty_deg == pytest.approx(np.hypot(*halves))


def test_with_many_repeats_it_is_the_textbook_interval():
    rng = np.random.default_rng(1)
    repeats = [rng.normal(mean, 0.3, 2000) for mean in (3.0, 2.0)]
    trials = [trial(hand, float(value)) for hand, values in zip("AB", repeats, strict=True) for value in values]
    (found,) = compare([source("s", *trials)]).differences
    assert found.uncertainty_deg == pytest.approx(1.96 * 0.3 * (2 / 2000) ** 0.5, rel=0.05)


def test_an_interval_cut_at_zero_does_not_make_the_uncertainty_small():
    (found,) = compare([source("s", trial("A", 0.1, (0.0, 0.9)), trial("B", 0.0, (0.0, 0.05)))]).differences
    assert found.uncertainty_deg == pytest.approx((0.8**2 + 0.05**2) ** 0.5)
    assert not found.larger


def test_of_many_differences_a_note_states_what_chance_does():
    rows = [trial(f"hand {k}", 1.0 + k, (0.5 + k, 1.5 + k)) for k in range(7)]
    assert "21 differences are judged" in compare([source("s", *rows)]).notes[-1]
    assert compare([source("s", *rows[:3])]).notes == ()


def test_other_objects_and_motions_are_not_compared():
    found = compare([source("s", trial("A", 1.0), trial("B", 2.0, thing="sphere"), trial("C", 3.0, motion="pitch"))])
    assert found.differences == ()


def test_the_same_hand_in_two_laboratories_stays_two_rows():
    found = compare([source("lab 1", trial("A", 1.0)), source("lab 2", trial("A", 2.0), trial("B", 3.0))])
    assert [row.hand for row in found.rows] == ["A [lab 1]", "A [lab 2]", "B"]


def test_mixed_rules_are_refused_or_noted():
    sources = [source("old", trial("A", 1.0), rules=(("score version", "0"),)), source("new", trial("B", 1.0))]
    with pytest.raises(ComparisonError, match="score version is '0' in old, '1' in new"):
        compare(sources)
    assert any(note.startswith("MIXED: score version") for note in compare(sources, mix=True).notes)


@pytest.fixture(scope="module")
def doubtful():
    """Of two hands one is of a source that nobody verified."""
    sources = [
        source("lab", trial("A", 1.0, (0.7, 1.3))),
        source("bare", trial("B", 2.0, (1.6, 2.4)), unverified="a | bare result"),
    ]
    return compare(sources)


def test_what_was_not_verified_is_marked_in_every_table_figure_and_sentence(doubtful):
    assert doubtful.notes == ("NOT verified: bare: a | bare result",)
    assert [row.verified for row in doubtful.rows] == ["yes", "not verified: a | bare result"]
    assert difference_text(doubtful.differences[0]).endswith("; not verified: B")
    rows = list(csv.DictReader(io.StringIO(summary_csv(doubtful.rows))))
    assert [row["verified"] for row in rows] == ["yes", "not verified: a | bare result"]
    head, _, *lines = summary_markdown(doubtful.rows).splitlines()
    assert head.endswith("| trials | verified |")
    assert [line.rsplit("| ", 1)[1] for line in lines] == ["yes |", "bare result |"]
    assert lines[1].endswith("| not verified: a \\| bare result |"), "the text ends no cell"
    latex = summary_latex(doubtful.rows)
    assert "{lllrrrrl}" in latex
    assert "1 & yes \\\\" in latex
    assert "not verified: a \\textbar{} bare result \\\\" in latex
    texts = [text.get_text() for text in forest_figure(doubtful.rows).findobj(matplotlib.text.Text)]
    assert [text for text in texts if "n = 1" in text] == [
        "1.000 (0.700 … 1.300), n = 1",
        "2.000 (1.600 … 2.400), n = 1, not verified",
    ]


def test_every_page_of_the_site_marks_what_was_not_verified(doubtful):
    files = site_files(doubtful, "0")
    marked = {
        name
        for name, content in files.items()
        if '<td class="warn">not verified: a | bare result</td>' in content.decode()
    }
    # The page of hand A has no row of B, and names it in the difference and in the notes.
    assert marked == {"index.html", "hand-b.html", "object-cube.html"}
    for name in (name for name in files if name.endswith(".html")):
        page = files[name].decode()
        assert "<li>NOT verified: bare: a | bare result</li>" in page, name
        assert "; not verified: B</li>" in page, name
        assert page.count("<td>yes</td>") == (name != "hand-b.html"), name


def test_the_summary_of_a_submission_has_no_such_column():
    """It is part of what is verified."""
    rows = pool([trial("A", 1.0, (0.7, 1.3))])
    assert not any(
        "verified" in table.lower() for table in (summary_markdown(rows), summary_csv(rows), summary_latex(rows))
    )


HOSTILE = '<script>alert(1)</script> & | $x_1$ \\ =HYPERLINK("x")'


@pytest.fixture(scope="module")
def comparison():
    return compare(
        [source("s", trial("A", 1.0, (0.7, 1.3)), trial(HOSTILE, 2.0, (1.6, 2.4)), trial("A", None, thing=HOSTILE))]
    )


def test_tables_keep_foreign_text_in_its_cell(comparison):
    markdown, latex, table = (f(comparison.rows) for f in (summary_markdown, summary_latex, summary_csv))
    assert markdown.count("\n") == 2 + len(comparison.rows)
    assert "\\<script\\>" in markdown
    assert "\\textbackslash{} =HYPERLINK" in latex
    assert "\\$x\\_1\\$" in latex
    assert '"<script>alert(1)</script> & | $x_1$ \\ =HYPERLINK(""x"")"' in table


def test_names_in_latex_do_not_become_arguments_of_what_stands_before_them():
    comparison = compare([source("s", *(trial(name, 1.0, (0.7, 1.3)) for name in ("[T42]", "*best*", "a---b", "?`")))])
    latex = summary_latex(comparison.rows)
    rows = latex.partition("\\midrule\n")[2].splitlines()
    assert [row.partition(" & ")[0] for row in rows[:4]] == [
        "{*}best{*}",
        "?\\textasciigrave{}",
        "{[}T42]",
        "a-{}-{}-b",
    ]


def test_the_site_has_a_page_per_hand_and_object_and_only_relative_links(comparison):
    files = site_files(comparison, "0.1.0")
    assert files == site_files(comparison, "0.1.0")
    pages = {name for name in files if name.endswith(".html")}
    assert len(pages) == 1 + 2 + 2

    class Links(html.parser.HTMLParser):
        found: ClassVar[list[str]] = []

        def handle_starttag(self, tag, attrs):
            assert tag != "script"
            self.found += [value for name, value in attrs if name in {"href", "src"}]

    links = Links()
    for name in sorted(pages):
        links.feed(files[name].decode())
    assert {link for link in links.found if not link.startswith("data:")} <= set(files)
    assert pages - {"index.html"} <= set(links.found)


def test_the_forest_plot_is_drawn_for_rows_without_score_and_odd_names(comparison):
    figure = forest_figure(comparison.rows)
    assert theme.figure_bytes(figure, "svg").startswith(b"<?xml")
    assert "<script>alert" not in comparison_html(comparison, "0")


def test_very_long_names_leave_room_for_the_plot():
    names = ["W" * 200, "x" * 199 + "手", ""]
    rows = pool([trial(name, 1.0, (0.5, 1.5), thing="M" * 200, motion="m" * 200) for name in names])
    assert theme.figure_bytes(forest_figure(rows), "png").startswith(b"\x89PNG")  # a warning would be an error


@pytest.fixture
def bundles(tmp_path):
    from analysis.formats.named_csv import csv_text
    from host.cards.definitions import parse_cards
    from host.submission.contents import build_submission
    from host.submission.source import TrialSource
    from tests.scored_trials import scored

    for hand, drift in (("T42", 0.3), ("NDX", 2.0)):
        cards = parse_cards(f"[hand]\nmodel = '{hand}'\n[trial]\nmotion = 'roll'")
        series, result = scored(cycles=6, slip_deg=0.0, drift_deg=drift)
        built = build_submission([TrialSource({"roll.csv": csv_text(series).encode()}, cards)], drawings=False)
        (tmp_path / f"{hand}.zip").write_bytes(bundle_bytes(built.files))
    (tmp_path / "result.json").write_text(result_text(result))
    return tmp_path


def test_the_command_compares_bundles_results_and_folders(bundles, capsys):
    assert main(["compare", str(bundles)]) == 0
    printed = capsys.readouterr().out
    assert "NDX drifts" in printed
    assert "larger than the uncertainty" in printed
    assert "incomplete" in printed
    assert main(["compare", str(bundles / "T42.zip"), str(bundles / "NDX.zip"), "--out", str(bundles / "site")]) == 0
    assert (bundles / "site" / "index.html").is_file()
    assert main(["compare", str(bundles / "T42.zip"), "--out", str(bundles / "site")]) == 4
    for name in ("t.csv", "t.md", "t.tex", "t.html", "t.svg", "t.pdf"):
        assert main(["compare", str(bundles / "T42.zip"), "--out", str(bundles / name)]) == 0
        assert (bundles / name).stat().st_size > 100


def test_what_cannot_be_compared_is_refused(bundles, capsys):
    (bundles / "bad.json").write_text("[1, 2")
    assert main(["compare", str(bundles / "bad.json")]) == 4
    old = json.loads((bundles / "result.json").read_text())
    (bundles / "old.json").write_text(json.dumps({**old, "format": 0}))
    assert main(["compare", str(bundles / "old.json"), str(bundles / "T42.zip")]) == 2
    assert "--mix" in capsys.readouterr().err
    assert main(["compare", "--mix", str(bundles / "old.json"), str(bundles / "T42.zip")]) == 0
    assert "MIXED" in capsys.readouterr().out


def cells(text):
    """The last column of a Markdown table, by hand."""
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return {row[0].removeprefix("| "): row[-1].removesuffix(" |") for row in rows[1:]}


def forged(bundle, alter):
    """Alter ``submission.json``, and write the checksums again."""
    files = read_bundle(bundle)
    values = json.loads(files["submission.json"])
    alter(values)
    return bundle_bytes(
        {**files, "submission.json": (json.dumps(values, indent=1, ensure_ascii=False) + "\n").encode()}
    )


def test_the_command_scores_submissions_again_and_marks_the_rest(bundles, capsys):
    assert main(["compare", str(bundles)]) == 0
    printed = capsys.readouterr().out
    assert cells(printed) == {
        "NDX": "yes", "T42": "yes", "unknown hand": "not verified: a bare result: its recording is not in it",
    }  # fmt: skip
    assert "NOT verified: result: a bare result: its recording is not in it" in printed
    assert main(["compare", str(bundles / "T42.zip"), str(bundles / "NDX.zip"), "--no-verify"]) == 0
    assert set(cells(capsys.readouterr().out).values()) == {"not verified: left out on request"}


def test_numbers_that_the_recordings_do_not_give_are_not_compared(bundles, capsys):
    def flatter(values):
        values["trials"][0]["theta_bar_deg"] -= 0.1
        values["summary"][0]["theta_bar_mean_deg"] -= 0.1

    def rename(values):
        values["trials"][0]["hand"] = "T42 (verified)"

    for alter in (flatter, rename):
        (bundles / "forged.zip").write_bytes(forged(bundles / "T42.zip", alter))
        assert main(["compare", str(bundles / "forged.zip"), str(bundles / "NDX.zip")]) == 4
        assert "forged.zip is not what its recordings give (" in capsys.readouterr().err
        # Unverified they are shown as such.
        assert main(["compare", str(bundles / "forged.zip"), "--no-verify"]) == 0
        assert set(cells(capsys.readouterr().out).values()) == {"not verified: left out on request"}


def test_what_this_program_cannot_score_again_is_marked(bundles, capsys):
    def date(values):
        values["score_version"] = "0"

    (bundles / "old.zip").write_bytes(forged(bundles / "T42.zip", date))
    assert main(["compare", "--mix", str(bundles / "old.zip"), str(bundles / "NDX.zip")]) == 0
    assert cells(capsys.readouterr().out) == {
        "NDX": "yes", "T42": "not verified: made by score version 0, this program computes 1",
    }  # fmt: skip
