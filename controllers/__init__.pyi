from .autopilots import autopilot as autopilot, usual_autopilot as usual_autopilot
from .composed.envelope import Envelope as Envelope
from .composed.excited import Excited as Excited
from .composed.loops import Cascade as Cascade, Joint as Joint, Mirrored as Mirrored
from .composed.scheduled import Scheduled as Scheduled
from .controller import Controller as Controller
from .gains import Gains as Gains, gains_for as gains_for, read_gains as read_gains, write_gains as write_gains
from .pid import Pid as Pid, float_depth_pid as float_depth_pid, heading_pid as heading_pid
from .piloting import pilot_for as pilot_for
from .predictive.gpc import Gpc as Gpc
from .relay import Relay as Relay, zigzag as zigzag
from .s_plane import SPlane as SPlane
from .trials.settling import step_response as step_response
