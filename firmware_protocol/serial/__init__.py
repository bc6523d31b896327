"""The protocol on byte links: COBS frames in a stream."""
