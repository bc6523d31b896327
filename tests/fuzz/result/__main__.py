"""``python -m tests.fuzz.result``: structure-aware inputs, sent all the way to the result file.

python -m tests.fuzz.result                                    every target, 500 inputs each
python -m tests.fuzz.result serial --inputs 20000 --seed 7
python -m tests.fuzz.result serial --only 1234 --seed 7        one input again; whatever it raises is shown
nice -n 19 python -m tests.fuzz.result serial --state serial.json --slices 100 --processor-s 3600
                                                               goes on where the file says; may be stopped any time
"""

import os
import sys

if __name__ == "__main__":
    for library in ("OPENBLAS", "OMP", "MKL"):  # each of their threads claims address space, and is of no use here
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")

    from tests.fuzz.result.command import main  # loads numpy, which reads what is set above

    sys.exit(main())
