"""Records: named signals with units over time, and the formats of logs that they are read from."""
