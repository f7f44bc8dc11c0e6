"""The kinds of part in auv-gym, one module each; see `vehicles.body.kinds`."""
