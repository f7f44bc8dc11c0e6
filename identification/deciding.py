"""The constants that decide what a diagnosis says, in one place: bars, levels, widths, shares and smallest sizes.

The text below each says what it decides and its source: a probability, a derivation, or "convention" if another value
would do as well.  Constants that only control the numerics (steps, iterations, tolerances) are where they are used.
`python -m scripts.pages.what_decides` writes the table of them in docs/diagnosis_method.md.
"""

from math import sqrt

from scipy.stats import chi2, norm

# Shared: probabilities and widths that several steps use

FALSE_ALARM = 1e-3
"""Probability of any false name on a log without a missing effect, over all candidates.  Source: chosen."""
MISSED = 0.05
"""Probability that an interval does not hold the truth.  Source: the usual 95 % interval."""
SURE = 3.0
"""Standard errors by which a size must differ from neutral.  Source: convention (0.3 %, two-sided)."""
TIE = SURE**2
"""Evidence between two explanations below which a log does not tell them apart.  Source: `SURE` squared."""
LEAST_PROBABLE = float(norm.sf(0.5 * sqrt(TIE)))
"""Probability from which an explanation is one of a tie.
Source: share of the halves of a log that prefer the worse of two explanations that differ by `TIE`."""
PRICE = 2.0
"""Evidence that each parameter more must bring where models are compared.  Source: Akaike 1974."""

# Check: is the log itself right?

MOST_PARTS = 6
"""Parts of a log.  Source: gives twenty halves of three parts, and five sixths to fit without any one part."""
MOST_FOLLOWED = 48_000
"""Samples times states of the vehicle from which on a first search counts a part of the log.
Source: time; four thousand samples of a body in six degrees of freedom."""
LEAST_WINDOWS = 4
"""Fewest windows of free runs in a log.  Source: convention."""
SETTLE_SHARE = 0.2
"""Share of a short window to which its start is fitted.  Source: convention."""
MOST_GROWTH = 60.0
"""Most growth of the first reading's noise in a window.  Source: beyond it, fits of starts end in a wrong minimum."""
SLIP_GAIN = 4.0
"""Factor in squared error that undoing a slip must gain.  Source: convention, measured by `scripts.studies.slips`."""
SLIP_LEFT = 0.25
"""Most error that undoing a slip may leave, over the signal's variance.  Source: as `SLIP_GAIN`."""
POOR = 0.1
"""Error from which a run is poor, over the signal's variance.  Source: as `SLIP_GAIN`."""
ALONE = 0.2
"""Error from which one sensor may have slipped by itself.  Source: less than knots make, (1 - 0.514)^2."""
BAD = 0.5
"""Error from which a sensor is still wrong, and a signal that hardly moves is stray.  Source: as `SLIP_GAIN`."""
FOREIGN = 0.55
"""Mean error from which a log is of another vehicle.  Source: as `SLIP_GAIN`."""
CLEAN = 2.0
"""Squared error over the noise's variance up to which an undone slip leaves nothing else.  Source: convention."""
FLOOR = 0.01
"""Mean error below which there is nothing to gain.  Source: convention."""
FACTOR = 3.0
"""Factor by which a coefficient may differ from its given value while slips are sought.  Source: convention."""
MOSTLY = 4.0
"""Variance of a signal over its noise's up to which it is mostly noise.  Source: half of its deviation is noise."""
FASTEST = 15.0
"""Speed, m/s, beyond which a channel is not what it says.  Source: no vehicle of these kinds is faster."""
KINEMATIC_BLOCK = 20.0
"""Time over which kinematics integrates, s; each block has a constant of its own.  Source: convention."""
LEAST_OF_BLOCK = 12
"""Fewest samples of such a block.  Source: convention."""
FEWEST_BLOCKS = 4
"""Fewest blocks for an interval.  Source: leaves three degrees of freedom."""
PLAINLY = 4.0
"""Standard errors from which kinematics names a sensor.  Source: `FALSE_ALARM` over 16 sensor effects, two-sided."""
WORTH_TELLING = 0.5
"""Probes from which a sensor's error is worth telling.  Source: convention."""
NEARLY = 0.8
"""Share of the most evidence that makes another sensor effect a rival.  Source: convention."""
CLEARED = 3.0
"""Probes within which the interval of a sensor must lie to clear it.  Source: convention."""

# Fit: what is known of the vehicle, and what pushes it

DOUBT = 0.1
"""Relative standard deviation of a coefficient that states none, `--doubt`.  Source: convention."""
REACH = 5.0
"""Standard deviations by which a fit may move a coefficient; more would hide an effect.  Source: convention."""
HELD = 0.5
"""Standard errors by which coefficients that are held may together move an estimate, at the most.
Source: convention, a bound by Cauchy and Schwarz; what they really move it by is far less."""
COST = 5.4
"""Log-likelihood that each acceleration must bring, or weak pushes that last would hide a steady effect.
Source: half the 0.1 % point of chi-square with one degree of freedom."""
LONGEST_SWELL = 25.0
"""Longest period, s, at which waves are looked for.  Source: the longest ocean swell."""
SHORTEST_INTERNAL_WAVE = 150.0
"""Shortest period, s, at which internal waves are looked for.  Source: the buoyancy period of a sharp thermocline."""
LONGEST_INTERNAL_WAVE = 3600.0
"""Longest such period, s, and no longer than half of a stretch.  Source: the buoyancy period of deep water."""
MOST_SWELLS = 3
"""Most periods of waves.  Source: convention, time: each is two more states of the filter for each velocity."""
LEAST_OF_SWELL = 2
"""Fewest velocities that waves push.  Source: a sea moves a vehicle more ways than one; a loop that swings need not."""
FORETELLS = 0.1
"""By how much free runs must be nearer to the log for a search without further noises to count instead of one with
them, mean logarithm over channels.  Source: convention; noises foretell nothing, an effect that does is worth more."""
LEAST_PROCESS = 1e-6
"""Size of an acceleration, in its unit; ten times more count as there.  Source: far below any that matters."""

# Search: which candidates are tried

SEEN = 1e-4
"""Share of a signature's power that must remain beside what imitates it.  Source: a hundredth of its size."""
ONLY_STARTS = 1e-5
"""Share of a signature's power below which starts alone imitate it.  Source: above the rounding of slopes."""
LEAST_TRACE = 0.2
"""Share of the bar that a candidate must promise to be fitted.  Source: convention."""
SHORT_LIST = 10
"""Candidates that are begun, however little they promise.  Source: convention, time."""
MANY = 100
"""Candidates from which on parts of the vehicle are tested first.  Source: convention, time."""
PART_LEVEL = 0.05
"""Probability with which a part that lacks nothing is searched all the same.  Source: usual."""
HERE = 5
"""Of these, candidates that promise most from the state as it is.  Source: half of `SHORT_LIST`."""
CLOSE = 0.5
"""Share of the best promise from which more are begun.  Source: convention."""
FINALISTS = 3
"""Candidates that are fitted to the end.  Source: convention, time."""
CLOSER = 0.8
"""Share of the best promise from which more are fitted to the end.  Source: convention."""
PROMISED = 0.5
"""Share of what an effect must bring that few steps of its fit must promise.  Source: convention, time."""
HOPELESS = 60.0
"""Evidence by which an effect is behind at the noises of another, too much to make up.  Source: convention."""
FAR_FROM_GIVEN = DOUBT
"""Relative change of a coefficient from which a search also begins at its given value.  Source: `DOUBT`."""
PLAIN = 100.0
"""Evidence by kinematics that settles a sensor before forces are sought.  Source: ten standard errors, squared."""
MOST_EFFECTS = 3
"""Most effects that are named, `--most`.  Source: convention."""
PAIRS = 3
"""Pairs of effects of each screening that are begun.  Source: convention, time."""
MOST_WORK = 1e8
"""Samples over which a search may run the vehicle; then it ends with what it has, and says so.  Source: time, some
ten minutes of one core.  A torpedo's log of five minutes with two effects takes a quarter of it."""
FEW_STATES = 4
"""States of the filter up to which effects are exchanged for each other, and all are sought in parts of a log.  Source:
time; with more it takes minutes."""

TIMED = 12
"""Effects and coefficients whose times are sought, of a vehicle with more states: those in which sixths of the log seem
to differ most.  Source: time, a torpedo has a hundred, each with 69 times and forms; convention."""

# Search: what is accepted, and what is tied with it

EFFECT_LEAST = float(chi2.isf(0.1, 1))
"""Evidence for an effect that parts must foretell of each other.  Source: 5 % point of one parameter, one-sided."""
EFFECT_SHARE = 0.02
"""Share of the evidence for an effect that parts must foretell of each other.  Source: convention."""
TERM_LEAST = float(chi2.isf(0.01, 1))
"""The same for a term; terms are many, and none is expected.  Source: 0.5 % point of one parameter, one-sided."""
TERM_SHARE = 0.1
"""Share of the evidence for a term that parts must foretell of each other.  Source: convention."""
HELD_BACK = float(norm.isf(MISSED / 2.0))
"""Standard errors by which a log asks for an effect beyond the limit of its size, so that the limit is not its size.
Source: `MISSED`, the limit is not in the 95 % interval."""
IDLE = 2.0
"""Standard errors within which one of two components is dropped.  Source: `MISSED`, two-sided, rounded."""
ALIKE = 0.9
"""Cosine from which two signatures are alike.  Source: convention (26 degrees)."""
SAME = 4e-6
"""1 - cosine^2 below which two signatures are the same.  Source: slopes are true to 0.2 %."""
EQUAL = 0.01
"""Evidence between two fits that is due to where they stopped.  Source: twice the gain at which a fit stops."""
MAJORITY = 0.5
"""Share of the halves of a log, more than which must see something.  Source: most of them."""
SEEN_BY_HALF = 0.5
"""Share of the bar's part that a half must see.  Source: a half sees what just passes as often as not."""
RIVAL = 0.1
"""Share of the halves of a log whose choice joins a tie.  Source: two of twenty; one may be chance."""

# Search: whether something is left, and terms for it

LEFT = 0.005
"""Probability that one of eight tests sees something left where nothing is.  Source: convention, 4 % for all."""
GUST_PARTS = 16
"""Parts of a log in which random accelerations may be stronger; halves and quarters of so many are tried, too.
Source: convention."""
PIECES = 8
"""Pieces of a signal's range, at whose edges a law may step, switch or rise that process noise follows.
Source: convention."""
FEWER_PIECES = 4
"""The same for vehicles with many states.  Source: computing time."""
WEIGHED = 4
"""Likeliest laws that are weighed with noises of their own where none is sure otherwise.  Source: computing time."""
CLOCK_PARTS = 24
"""Parts of a log, in each of which its clock may have another rate; half as many are tried, too.
Source: convention."""
EXCESS = 0.01
"""Share of the variance that the colour of errors must predict.  Source: convention."""
STABLE = 0.8
"""Share of the halves that must choose a term; an effect that fewer choose is said to be so.  Source: convention."""
KIN = 0.5
"""Cosine to the leading term from which a term contends with it.  Source: convention (60 degrees)."""
CONTENDERS = 5
"""Terms that are begun; effects sought in parts of a log where all take too long.  Source: convention, time."""
NEAR = 0.1
"""Share of the best gain within which a term is fitted to the end.  Source: convention."""
BLOCKS = 24
"""Blocks of a log that are compared or resampled.  Source: each far longer than a filter remembers."""
LEAST_BLOCK = 8
"""Fewest samples of such a block.  Source: convention."""
MOST_TERMS = 2
"""Most terms that are found.  Source: convention."""

# Judge: the verdict, and what is said beside it

EXPLAINED = 0.5
"""Share of the excess error that named effects must remove.  Source: most of it."""
MANY_WINDOWS = 8
"""Windows from which free runs say how far a vehicle is off.  Source: convention."""
LEAST_CHANGE = 0.02
"""Relative change from which a coefficient counts as wrong.  Source: convention."""
SURPRISE = float(norm.isf(0.5 * MISSED))
"""Stated standard deviations from which a coefficient counts as wrong.  Source: `MISSED`, two-sided."""
BEYOND = 2.0 * DOUBT
"""Relative change of a coefficient from which the effect that acts alike is as likely.  Source: twice `DOUBT`."""
SLIGHT = 1.0
"""Change of free runs, over the noise of a reading, that is called little.  Source: less than one reading shows."""
UNSTEADY = FALSE_ALARM
"""Probability of a difference between parts below which an effect is not of one size.  Source: `FALSE_ALARM`."""
SLIGHTLY = 0.2
"""Share of the size of an effect by which parts of a log may differ from it where it is named all the same.
Source: convention; what is certain in a long log may be small, and conditions change any force somewhat."""
SIMILAR = 60.0
"""Degrees between signatures below which a result file has the angle.  Source: convention."""
LEVEL = 0.05
"""Probability of any false statement about where a residual is, and of a term in a half without.  Source: usual."""
BINS = 6
"""Bins over which a residual is spread, with as many samples each.  Source: convention."""
LEAST_EXCHANGED = 6
"""Fewest windows that are exchanged or compared.  Source: their 720 orders resolve `LEVEL`."""
MOST_OF_ERROR = 0.5
"""Share of the squared error that is called most of it.  Source: a half."""
LEAST_POWER = 0.05
"""Share of the power around a period that is worth a sentence.  Source: convention."""
LEAST_GROWTH = 1.5
"""Growth of the error within a run that is worth a sentence.  Source: convention."""
LEAST_FOR_SPECTRUM = 32
"""Fewest samples of a window for a spectrum.  Source: convention."""
UNEVEN = 0.1
"""Relative difference of sampling intervals that a spectrum allows.  Source: convention."""
SLOWEST = 2
"""Fewest periods that a window must hold.  Source: a single one may be a drift."""
