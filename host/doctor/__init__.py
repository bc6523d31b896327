"""The checks of ``rotdrift doctor``: the machine, and a link."""
