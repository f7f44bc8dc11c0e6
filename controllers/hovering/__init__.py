"""Control of vehicles held in place by thrusters: their dynamics, references, and control laws."""
