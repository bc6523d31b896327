#!/usr/bin/env bash
# A matplotlib figure with a rasterized artist (how a cloud of many points is kept small), saved as SVG and placed in a PDF
# by fpdf2, loses that artist: it is drawn above the page. matplotlib writes <image transform="scale(1 -1) translate(0 -h)">,
# and fpdf2 leaves the transform of an image out with no more than a log line; paths and text of the same figure are right.
#
# Guessed: the picture looks as in a browser, or an error says that it cannot.
# Seen with matplotlib 3.11.2, fpdf2 2.8.9, pypdf 7.1.1 (2026-12-01):
#   in the SVG the image reaches from y = 23.04 to 84.96 pt below the top
#   in the PDF the image reaches from y = -23.04 to 38.88 pt below the top
# Place such a figure as PNG, or rasterize the whole figure. Exit code 1 when this changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv venv
venv/bin/pip install --quiet matplotlib==3.11.2 fpdf2==2.8.9 pypdf==7.1.1
cat > seen.py <<'PY'
import io
import re

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from fpdf import FPDF
from pypdf import PdfReader

figure = plt.figure(figsize=(4, 3))
axes = figure.add_axes([0.6, 0.6, 0.3, 0.3])
axes.plot([0, 1], [0, 1], rasterized=True)
figure.savefig("figure.svg")
image = re.search(r"<image(.*?)>", open("figure.svg", encoding="utf-8").read(), re.DOTALL)[1]
shift = float(re.search(r'transform="scale\(1 -1\) translate\(0 (-?[\d.]+)\)"', image)[1])
top, height = (float(re.search(rf' {name}="(-?[\d.]+)"', image)[1]) for name in ("y", "height"))
right = sorted(-(y + shift) for y in (top, top + height))
print(f"in the SVG the image reaches from y = {right[0]:.2f} to {right[1]:.2f} pt below the top")

pdf = FPDF(unit="pt", format=(288, 216))
pdf.add_page()
pdf.image("figure.svg", x=0, y=0, w=288)
page = PdfReader(io.BytesIO(bytes(pdf.output()))).pages[0]
content = page.get_contents().get_data().decode("latin1")
_, _, _, tall, _, bottom = map(float, re.search(r"((?:-?[\d.]+ ){6})cm /I1 Do", content)[1].split())
found = sorted((bottom, bottom + tall))
print(f"in the PDF the image reaches from y = {found[0]:.2f} to {found[1]:.2f} pt below the top")
raise SystemExit(abs(found[0] - top) > 0.01 or abs(right[0] - found[0]) < 1.0)
PY
venv/bin/python seen.py 2> /dev/null
