"""Results for people and for other laboratories: figures, report, submission, comparison.

The only place that knows matplotlib, jinja2 and plotly. It works on what a score says of itself
(``TrialScore.to_json()``) and on the series it came from; it reads no cards and no links.
"""
