"""Errors become exit codes in one place."""

import os
import subprocess
import sys

import pytest

from semantic_slam.cli.exit_codes import CommandParser, exit_code, run_main
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
    assert exit_code(raising(KeyboardInterrupt())) == 130
    assert capsys.readouterr().err == ""


INTERRUPTED = """
import atexit, signal, threading, time
from semantic_slam.cli.exit_codes import run_main
def command():
    print("begun")
    atexit.register(print, "all others are done")
    threading.Thread(target=time.sleep, args=[600], daemon=True).start()
    exec("signal.raise_signal(signal.SIGINT)")
signal.signal(signal.SIGINT, signal.default_int_handler)
run_main(command)
"""


def test_an_interrupt_within_code_that_is_executed_from_text_is_130_too():
    """Python itself would end by the signal, which dataclasses and named tuples then make of it."""
    ended = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (130, "")
    assert ended.stdout.splitlines() == ["begun", "all others are done"]


UNREAD = """
from semantic_slam.cli.exit_codes import run_main
def command():
    for number in range(LINES):
        print("a line of what is printed", number)
    LAST
run_main(command)
"""


@pytest.mark.parametrize(("lines", "last"), [(1, "pass"), (100_000, "pass"), (1, "raise SystemExit(0)")])
def test_a_command_whose_reader_leaves_ends_without_a_word(lines, last):
    """Whether what is left fits into a buffer that is written at the end or not; a shell knows 141 from SIGPIPE."""
    text = UNREAD.replace("LINES", str(lines)).replace("LAST", last)
    reader, writer = os.pipe()
    os.close(reader)
    ended = subprocess.run([sys.executable, "-c", text], stdout=writer, stderr=subprocess.PIPE, timeout=60)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (141, b"")


def test_a_pipe_that_breaks_within_is_a_fault(capfd):
    assert leave(raising(BrokenPipeError(32, "Broken pipe"))) == 1
    assert "BrokenPipeError" in capfd.readouterr().err


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

    assert exit_code(in_the_midst_of_an_import) == 130
    assert capsys.readouterr().err == ""
