"""`python -m auv_gym.cli`."""

import sys

from auv_gym.cli import main

sys.exit(main())
