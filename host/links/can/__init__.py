"""CAN links through python-can, and logs of other CAN tools."""
