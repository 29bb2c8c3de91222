"""Errors become exit codes in one place."""

import pytest

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError, SemanticSlamError


def leave(command):
    with pytest.raises(SystemExit) as left:
        run_main(command)
    return left.value.code


def raising(error):
    def command():
        raise error

    return command


def test_done(capsys):
    assert leave(lambda: None) == 0
    assert capsys.readouterr().err == ""


def test_bad_input_is_one_line(capsys):
    assert leave(raising(InputError("a.bag: is\nbroken; mend it"))) == 2
    assert capsys.readouterr().err == "a.bag: is broken; mend it\n"


@pytest.mark.parametrize("error", [SemanticSlamError("lost"), ZeroDivisionError("x")])
def test_a_fault_of_ours_shows_where(error, capsys):
    assert leave(raising(error)) == 1
    assert "Traceback" in capsys.readouterr().err


def test_an_interrupt_is_quiet(capsys):
    assert leave(raising(KeyboardInterrupt())) == 130
    assert capsys.readouterr().err == ""


def test_wrong_usage_is_one_line(capsys):
    parser = CommandParser(prog="tool")
    parser.add_subparsers(required=True, dest="what").add_parser("one").add_argument("--n", type=int)
    assert leave(lambda: parser.parse_args(["one", "--n", "x"])) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("tool one: argument --n: invalid int value: 'x'")


def test_help_is_no_error(capsys):
    assert leave(lambda: CommandParser(prog="tool").parse_args(["--help"])) == 0
    assert "usage: tool" in capsys.readouterr().out


def test_an_interrupt_that_became_another_exception_is_an_interrupt(capsys):
    def in_the_midst_of_an_import():
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as fault:
            raise ImportError("initialization failed") from fault

    assert leave(in_the_midst_of_an_import) == 130
    assert capsys.readouterr().err == ""
