"""Results for people and for other laboratories: figures, report, comparison.

The only place that knows matplotlib, jinja2 and fpdf2; it works on results and on the series they came from.
"""
