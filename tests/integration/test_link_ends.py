"""No peer makes a command wait without end: every link, every command that opens one, every way of being no object."""

import contextlib
import gc
import signal
import threading
from itertools import product

import pytest

from host import stop_signals
from host.capture.settings import CaptureSettings
from host.cli import build_parser
from host.commands import baseline, capture, doctor, ports
from host.errors import LinkError
from host.links import opening
from host.links.can import drivers, socketcand
from host.stream.session import SessionSettings
from tests.command_line import BASE, Program
from tests.hostile_peers import LINKS, PEERS, hostile_link, in_thread
from tests.waiting import HANG_S, wait_for, wait_for_thread

pytestmark = [
    # pyserial's rfc2217 uses names of threading that are deprecated, and its thread fails when the server has gone.
    pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
COMMANDS = {
    "capture": (capture.run, ["capture", "{link}", "--duration", "0.2", "--reconnect", "0.5", "--out", "{folder}/x"]),
    "baseline": (baseline.run, ["baseline", "{link}", "--duration", "0.2"]),
    "doctor": (doctor.run, ["doctor", "{link}", "--seconds", "0.5", "--folder", "{folder}"]),
}
LONG_S = 1000.0
"""Where only a stop can end what waits."""
AT_MOST = 6
"""Commands at once."""


@pytest.fixture(autouse=True)
def nothing_is_left():
    """Collect what the libraries leave open where a peer vanishes as they open it, before the next test is blamed."""
    yield
    gc.collect()


def defaults(kind, **values):
    """Defaults of a dataclass's fields in place of its own."""
    names = [name for name, field in kind.__dataclass_fields__.items() if field.init]
    own = dict(zip(names[-len(kind.__init__.__defaults__) :], kind.__init__.__defaults__, strict=True))
    return tuple((own | values).values())


def set_limits(monkeypatch, limit_s):
    """Have every wait for a peer last so long."""
    monkeypatch.setattr(SessionSettings.__init__, "__defaults__", defaults(SessionSettings, handshake_s=limit_s))
    monkeypatch.setattr(
        CaptureSettings.__init__,
        "__defaults__",
        defaults(CaptureSettings, session=SessionSettings(), silence_limit_s=limit_s, reconnect_s=limit_s),
    )
    monkeypatch.setattr(opening.open_within, "__defaults__", (None, limit_s))
    monkeypatch.setattr(drivers, "SLCAN_ANSWER_S", limit_s)
    monkeypatch.setattr(drivers, "RETRY_S", min(limit_s, 0.2))
    monkeypatch.setattr(socketcand, "ANSWER_S", limit_s)


def ended(command, link, peer, folder, stopped=None):
    """Run a command against a peer; return how it ended."""
    run, words = COMMANDS[command]
    with hostile_link(link, peer) as uri:
        folder.mkdir()
        args = build_parser().parse_args([word.format(link=uri, folder=folder) for word in words])
        outcome = []

        def work():
            try:
                outcome.append(run(args))
            except BaseException as error:  # noqa: BLE001 - whatever comes is judged
                outcome.append(error)

        thread = in_thread(work)
        if stopped is not None:
            stopped(thread)
        wait_for_thread(thread)
    return outcome[0]


def in_parallel(cases, work):
    """Do work for every case, some at a time; raise the first failure."""
    waiting, failures, lock = list(cases), [], threading.Lock()

    def worker():
        while True:
            with lock:
                if not waiting or failures:
                    return
                case = waiting.pop()
            try:
                work(*case)
            except BaseException as error:  # noqa: BLE001 - raised again below
                failures.append(error)

    for thread in [in_thread(worker) for _ in range(AT_MOST)]:
        wait_for_thread(thread)
    if failures:
        raise failures[0]


CASES = [(link, peer) for link, peer in product(LINKS, PEERS)]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_peer_that_is_no_object_ends_the_command_with_one_sentence(command, tmp_path, monkeypatch, capsys):
    set_limits(monkeypatch, 0.3)

    def check(link, peer):
        outcome = ended(command, link, peer, tmp_path / f"{link} {peer}")
        if command == "doctor":
            assert outcome == 3, (link, peer)
            return
        assert isinstance(outcome, LinkError), (link, peer, outcome)
        assert outcome.exit_code == 3
        assert outcome.message
        assert "\n" not in str(outcome)
        assert not list(tmp_path.glob(f"{link} {peer}/*.mcap")), "nothing was captured, so nothing is left"

    in_parallel(CASES, check)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_stop_ends_every_wait(command, tmp_path, monkeypatch):
    set_limits(monkeypatch, LONG_S)
    stops = threading.local()
    made = {}

    @contextlib.contextmanager
    def stop_on_signals():
        made[threading.get_ident()] = stop = threading.Event()
        yield stop

    del stops
    monkeypatch.setattr(stop_signals, "stop_on_signals", stop_on_signals)

    def check(link, peer):
        def stopped(thread):
            wait_for(lambda: thread.ident in made or not thread.is_alive(), "the command waits for signals")
            thread.join(0.1)  # in the middle of the opening, or of what follows it
            if thread.ident in made:
                made.pop(thread.ident).set()

        ended(command, link, peer, tmp_path / f"{link} {peer}", stopped)

    in_parallel(CASES, check)


def test_probing_ports_ends_whatever_is_there(monkeypatch, capsys):
    set_limits(monkeypatch, 0.3)
    monkeypatch.setattr("host.doctor.object_probe.objects_on.__defaults__", (0.2,))
    with contextlib.ExitStack() as stack:
        uris = [stack.enter_context(hostile_link(link, peer)) for link, peer in CASES if link != "rfc2217"]
        rows = [{"link": uri, "description": ""} for uri in uris]
        monkeypatch.setattr(ports, "_rows", lambda: rows)
        assert ports.run(build_parser().parse_args(["ports", "--probe"])) == 0
    assert "no object was heard" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "number"),
    [(["capture", "{link}", "--out", "x"], signal.SIGINT), (["doctor", "{link}"], signal.SIGTERM)],
)
def test_the_first_signal_ends_a_process_whose_peer_is_silent(words, number, tmp_path):
    accepted = []
    with hostile_link("tcp", "silent", accepted) as uri:
        # The server is asked for a bus, accepts, and greets nobody.
        link = uri.replace("serial:socket://", "can:socketcand:") + "/can0"
        program = Program([*BASE, *(word.format(link=link) for word in words)], cwd=tmp_path)
        wait_for(lambda: len(accepted) > 1, "a client that waits for the greeting")
        program.process.send_signal(number)
        assert program.process.wait(HANG_S) == 3
        if words[0] == "capture":
            assert "stopped before" in program.stderr.all()
