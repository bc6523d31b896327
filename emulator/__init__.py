"""A virtual sensorized object: known true drift, real wire, faults on demand."""
