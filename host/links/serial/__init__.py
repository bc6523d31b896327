"""Serial links through pyserial."""
