"""``rotdrift init`` asked and answered in a real pseudo-terminal."""

import sys

import pytest

from host.cards.definitions import load_cards, missing_fields
from tests.waiting import HANG_S

pexpect = pytest.importorskip("pexpect", reason="pexpect is not installed")
if sys.platform == "win32":
    pytest.skip("pseudo-terminals need POSIX", allow_module_level=True)


def start(folder, *arguments):
    command = ["-c", "import sys; from host.cli import main; sys.exit(main())", "init", str(folder), *arguments]
    return pexpect.spawn(sys.executable, command, encoding="utf-8", timeout=HANG_S, dimensions=(24, 200))


def test_a_trial_card_is_asked_for_and_a_wrong_answer_asked_again(tmp_path):
    terminal = start(tmp_path, "--card", "trial")
    answers = {
        "motion": "roll",
        "axis": "",
        "protocol": "P19-0838.3",
        "operator": "ab",
        "comments": "Ωmega, fine",
    }
    for name in ("motion", "axis", "protocol"):
        terminal.expect(rf"  {name}\*? \(")
        terminal.sendline(answers[name])
    terminal.expect(r"  repeats \(")
    terminal.sendline("many")
    terminal.expect("'many' is not a whole number")
    terminal.expect(r"  repeats \(")
    terminal.sendline("20")
    for name in ("operator", "comments"):
        terminal.expect(rf"  {name}\*? \(")
        terminal.sendline(answers[name])
    terminal.expect("wrote")
    terminal.expect(pexpect.EOF)
    terminal.close()
    assert terminal.exitstatus == 0
    cards = load_cards(tmp_path / "trial.toml")
    assert (cards.trial.motion, cards.trial.repeats, cards.trial.comments) == ("roll", 20, "Ωmega, fine")
    assert not [field for field in missing_fields(cards) if field.startswith("trial.")]


def test_ending_the_input_writes_nothing(tmp_path):
    terminal = start(tmp_path, "--card", "hand")
    terminal.expect(r"  model\*? \(")
    terminal.sendeof()
    terminal.expect("nothing written")
    terminal.expect(pexpect.EOF)
    terminal.close()
    assert terminal.exitstatus == 1
    assert list(tmp_path.iterdir()) == []
