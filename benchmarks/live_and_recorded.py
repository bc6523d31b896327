"""Many made sessions, live and from their recording: does anything differ, and does every account add up?

``python -m benchmarks.live_and_recorded --sessions 1000 --first 0`` runs the sessions of these seeds, all faults of the
emulator and values on the wire that no object would send, on a serial line, CAN and CAN FD, and prints what is wrong.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

from tests.ledger_sessions import KINDS, made_session, wrong_with


def main() -> int:
    """Run the sessions; return 1 where something is wrong with one."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sessions", type=int, default=200, metavar="N")
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    args = parser.parse_args()
    started_s, wrong, kinds, n_changed, n_chunks = time.process_time(), 0, Counter[str](), 0, 0
    for seed in range(args.first, args.first + args.sessions):
        session = made_session(seed)
        kinds[KINDS[seed % len(KINDS)]] += 1
        n_changed += len(session.mutations)
        n_chunks += len(session.chunks)
        found = wrong_with(session)
        wrong += bool(found)
        for line in found:
            print(f"session {seed} ({session.kind}): {line[:300]}", flush=True)
    cost_s = (time.process_time() - started_s) / args.sessions
    print(
        f"{args.sessions} sessions ({', '.join(f'{n} {kind}' for kind, n in kinds.items())}), {n_chunks} chunks, "
        f"{n_changed} changes on the wire: {wrong} with something wrong; {cost_s:.2f} s of processor time each"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
