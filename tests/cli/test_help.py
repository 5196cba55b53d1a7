"""The help: every command in one group, and examples that the commands' own parsers take."""

import shlex

import pytest
import typer

from msl_fem.cli.app import COMMANDS, app
from msl_fem.cli.help_texts import EXAMPLES, GROUPS

GROUP = typer.main.get_command(app)


def test_every_command_stands_in_one_group_and_has_examples() -> None:
    listed = [name for names in GROUPS.values() for name in names]
    assert sorted(listed) == sorted(COMMANDS) == sorted(EXAMPLES)


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_are_read_by_the_command_itself(name: str) -> None:
    """An option that is renamed, or a missing argument, ends in an exception of the parser."""
    command = GROUP.get_command(None, name)
    for example in EXAMPLES[name]:
        first, *words = shlex.split(example)
        assert first == name
        command.make_context(name, words)


def test_an_example_with_a_wrong_option_is_noticed() -> None:
    with pytest.raises(Exception, match="No such option"):
        GROUP.get_command(None, "solve").make_context("solve", ["servo.toml", "--curent", "3 A"])


def test_the_overview_shows_whole_sentences_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        app(["--help"])
    printed = capsys.readouterr().out
    assert "..." not in printed.partition("\n\n")[2]
    assert all(f"{group}:" in printed for group in GROUPS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_says_what_it_is(name: str) -> None:
    """A text that begins in the middle of a sentence ("Of the record.") is a riddle to who reads the help first."""
    for option in GROUP.get_command(None, name).params:
        text = option.help or ""
        assert len(text.split()) > 1, option.name
        assert text.split()[0] not in {"Of", "For", "Like", "That", "Whose", "Allowed,"}, option.name
