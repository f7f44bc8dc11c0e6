"""What holds a vehicle with thrusters in place: its dynamics as far as control needs them, references, and laws."""
