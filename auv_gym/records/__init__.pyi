from .density import Profile as Profile, read_profiles as read_profiles, with_density as with_density
from .reading import find_log as find_log, read_record as read_record
from .record import Record as Record, concat as concat
