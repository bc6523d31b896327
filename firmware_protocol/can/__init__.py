"""The protocol on a CAN bus: classic and FD frames."""
