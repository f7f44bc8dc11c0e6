"""Execution of a campaign's runs, in this process or by workers."""
