"""One module for each format of logs; each is found by its entry point, see `auv_gym.records.formats`."""
