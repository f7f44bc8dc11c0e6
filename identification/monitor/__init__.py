"""Alarms while a vehicle runs, at a stated rate of false ones, and the name of what has gone wrong."""
