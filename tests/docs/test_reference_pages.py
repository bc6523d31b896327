"""The pages of commands and of the result's keys say what the code does."""

from docs import command_reference, result_reference
from host.commands import COMMANDS

COMMAND_PAGE = command_reference.PAGE.read_text()
RESULT_PAGE = result_reference.PAGE.read_text()


def test_the_commands_are_those_of_the_parsers():
    assert command_reference.fill(COMMAND_PAGE) == COMMAND_PAGE, "run: python -m docs.command_reference"
    for name in COMMANDS:
        assert f"\n## {name}\n" in COMMAND_PAGE


def test_every_argument_has_a_meaning():
    for name, parser in command_reference.commands().items():
        assert parser.description, name
        for action in parser._actions:
            assert action.help, (name, action.dest)
            if action.help != "==SUPPRESS==" and action.dest != "help":
                shown = action.option_strings[-1] if action.option_strings else action.metavar
                assert shown.replace("|", "\\|") in command_reference.section(name, parser), (name, shown)


def test_the_keys_are_those_of_the_result_type():
    assert result_reference.fill(RESULT_PAGE) == RESULT_PAGE, "run: python -m docs.result_reference"


def test_every_key_has_a_meaning():
    numbers_of_the_method = "settings.cycles."  # explained where they are used
    assert [key for key in result_reference.missing_meanings() if not key.startswith(numbers_of_the_method)] == []
