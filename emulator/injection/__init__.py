"""The virtual object on its link, and the faults between the two."""

from emulator.injection.injector import FaultInjector

__all__ = ["FaultInjector"]
