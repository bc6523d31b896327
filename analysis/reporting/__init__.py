"""Results for people and for other laboratories: figures, report, submission, comparison.

The only place that knows matplotlib, jinja2 and plotly. It works on results and on the series they came
from; it reads no cards and no links.
"""
