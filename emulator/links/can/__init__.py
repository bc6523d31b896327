"""CAN links of the virtual object: real peers for python-can."""
