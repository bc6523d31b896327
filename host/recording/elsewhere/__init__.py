"""Trials that other programs logged: CAN logs, and the bare bytes of a serial link."""
