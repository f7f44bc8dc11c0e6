"""The kinds of part that come with auv-gym, one module each; see `vehicles.body.kinds`."""
