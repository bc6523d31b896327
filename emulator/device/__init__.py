"""The virtual object itself: sensor, clock, firmware and transmit queue."""
