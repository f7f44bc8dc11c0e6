"""Online monitoring: alarms at a stated false-alarm rate while a vehicle runs, and the cause of an alarm."""
