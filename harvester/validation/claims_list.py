"""Every statement of the source paper on trends, as data: where it stands and what tests it.

Conditions are those of the figure that the sentence speaks of. Sentences on E[V²] and E[P] are
general, so they are tried at D = 0.08 too, where jumps between the wells are frequent.
"""

from dataclasses import dataclass, field

from harvester.base.serialising import LEFT_OUT, key
from harvester.validation import EFFICIENCY, POWER, VOLTAGE
from harvester.validation.claim_tests import (
    Agreement,
    Bimodal,
    Changed,
    InteriorMaximum,
    LargerEffect,
    OppositeTrends,
    SingleHump,
    StatementTest,
    Trend,
    Unchanged,
    WiderBand,
)
from harvester.validation.paper_figures import (
    CORRELATION_TIME,
    COUPLING,
    DECAY_RATE,
    GAP,
    INTENSITY,
    RESTITUTION,
    STIFFNESS,
    Changes,
)

PEAK, REACH, CROSSINGS = "peak", "reach", "well_crossing_rate"


@dataclass(frozen=True)
class Claim:
    """One statement of a section of the paper.

    Attributes
    ----------
    sentence : str
        Quoted, shortened.
    says : str
        The tested statement in a few words.
    conditions : tuple of tuple of (key, value)
        Changes of the scene; the statement must hold under each of them.
    """

    section: str
    sentence: str
    says: str = field(metadata=key("tested"))
    test: StatementTest = field(metadata=LEFT_OUT)
    conditions: tuple[Changes, ...] = field(default=((),), metadata=LEFT_OUT)


def _each(changed, *values):
    return tuple(((changed, value),) for value in values)


SHORT, LONG = _each(CORRELATION_TIME, 0.4, 1.0)
JUMPING = ((INTENSITY, 0.08),)
GENERAL = (SHORT, LONG, JUMPING)
STOPPERS = (
    *_each(GAP, 1.1, 1.2, 1.3),
    *_each(RESTITUTION, 0.4, 1.0),
    *_each(STIFFNESS, 1.0, 7.0, 13.0),
)
DENSITIES = (
    *_each(GAP, 1.0, 1.2),
    *_each(RESTITUTION, 0.5, 0.9),
    *_each(STIFFNESS, 5.0, 13.0),
    *_each(INTENSITY, 0.03, 0.1),
    SHORT,
    LONG,
)
NOISES = ((INTENSITY, (0.03, 0.1)), (CORRELATION_TIME, (0.4, 1.0)))
ALL_NOISES = (*_each(INTENSITY, 0.005, 0.02, 0.08, 0.125), *_each(CORRELATION_TIME, 0.1, 1.1))
# A peak counts as changed if it changes by more than this share.
LITTLE = 0.05
GAPS, RESTITUTIONS, STIFFNESSES = (0.95, 1.1, 1.25), (0.3, 0.7, 1.0), (5.0, 10.0, 13.0)
INTENSITIES = (0.005, 0.02, 0.06, 0.1, 0.125)
DECAY_RATES, COUPLINGS = (0.03, 0.05, 0.09), (0.3, 0.6, 0.95)
CORRELATION_TIMES = (0.1, 0.4, 1.1)


def _claims(section, sentence, *tested):
    """Statements that one sentence makes: what is tested, by what, under which conditions."""
    return tuple(Claim(section, sentence, *test) for test in tested)


CLAIMS = (
    Claim(
        "2",
        "“The vibro-impact mechanism can cause the stochastic VEH system to produce "
        "a wider frequency band”",
        "orbits up to the same energy reach higher frequencies with stoppers (Fig. 3)",
        WiderBand(),
    ),
    Claim("4", "“their PDFs are found to be bimodal”", "p(X) has two peaks", Bimodal(), DENSITIES),
    Claim(
        "4",
        "“K and e are less affected by the system response than the variable δr”",
        "δr moves the peak of p(X) more than e and K",
        LargerEffect(
            PEAK, ((GAP, (1.0, 1.2)),), ((RESTITUTION, (0.5, 0.9)), (STIFFNESS, (5.0, 13.0)))
        ),
    ),
    Claim(
        "4, 5",
        "“the peak values of the PDF of the displacement response fall off rapidly "
        "as the parameter δr increases”",
        "the peak of p(X) falls with δr",
        Trend(PEAK, GAP, (1.0, 1.2), rises=False),
    ),
    Claim(
        "4",
        "“the system jumps from a steady-state point to another steady-state point "
        "more frequently”",
        "crossings of X = 0 become more frequent with δr",
        Trend(CROSSINGS, GAP, (1.0, 1.2)),
        ((), JUMPING),
    ),
    Claim(
        "4",
        "“increasing the other two variables (including e and K) did not cause any significant "
        "change in the peak PDF values”",
        "e and K change the peak of p(X) by less than 5 %",
        Unchanged(PEAK, ((RESTITUTION, (0.5, 0.9)), (STIFFNESS, (5.0, 13.0))), LITTLE),
    ),
    Claim(
        "4",
        "“increasing the noise parameters had a significant effect on the peak bimodal value of "
        "the PDF”",
        "D and τ1 change the peak of p(X) by more than 5 %",
        Changed(PEAK, NOISES, LITTLE),
    ),
    Claim(
        "4",
        "“increasing the parameter τ1 will increase the peak of the PDF of response”",
        "the peak of p(X) rises with τ1",
        Trend(PEAK, CORRELATION_TIME, (0.4, 1.0)),
    ),
    Claim(
        "4, 5",
        "“increasing the parameter D decreases the peak of the PDF of response”",
        "the peak of p(X) falls with D",
        Trend(PEAK, INTENSITY, (0.03, 0.1), rises=False),
    ),
    Claim(
        "5",
        "“increasing the position parameters δr, the restitution coefficient e, and the "
        "noise intensity D will decrease the peak value of the PDF”",
        "the peak of p(X) falls with e",
        Trend(PEAK, RESTITUTION, (0.5, 0.9), rises=False),
    ),
    Claim(
        "4",
        "“The lower PDF peak value of the VEH system response means that … the system may have a "
        "larger vibration range”",
        "where the peak of p(X) is lower |X| reaches farther (1 % of the time beyond)",
        OppositeTrends(PEAK, ((GAP, (1.0, 1.2)), *NOISES), REACH),
    ),
    *_claims(
        "4",
        "“The lower PDF peak value … will produce a higher energy harvesting efficiency”",
        (
            "where the peak of p(X) is lower E[P] is higher",
            OppositeTrends(PEAK, ((GAP, (1.0, 1.2)), *NOISES), POWER),
        ),
        (
            "where the peak of p(X) is lower PCE is higher",
            OppositeTrends(PEAK, ((GAP, (1.0, 1.2)), *NOISES), EFFICIENCY),
        ),
    ),
    *_claims(
        "4, 5",
        "“increasing δr, e and D will result in both mean square output and mean output "
        "power increasing”",
        ("E[V²] and E[P] rise with δr", Trend(VOLTAGE, GAP, GAPS), GENERAL),
        ("E[V²] and E[P] rise with e", Trend(VOLTAGE, RESTITUTION, RESTITUTIONS), GENERAL),
        ("E[V²] and E[P] rise with D", Trend(VOLTAGE, INTENSITY, INTENSITIES), (SHORT, LONG)),
    ),
    Claim(
        "4",
        "“the trends caused by δr and D are more significant in comparison”",
        "δr and D change E[V²] more than e",
        LargerEffect(
            VOLTAGE,
            ((GAP, (0.95, 1.25)), (INTENSITY, (0.005, 0.125))),
            ((RESTITUTION, (0.3, 1.0)),),
        ),
        (SHORT, LONG),
    ),
    Claim(
        "4, 5",
        "“for another parameter K, it has a different effect … than the previous three parameters”",
        "E[V²] and E[P] fall with K",
        Trend(VOLTAGE, STIFFNESS, STIFFNESSES, rises=False),
        GENERAL,
    ),
    Claim(
        "4, 5",
        "“the value of mean square output decreases gradually with increasing parameter λ”",
        "E[V²] falls with λ",
        Trend(VOLTAGE, DECAY_RATE, DECAY_RATES, rises=False),
        GENERAL,
    ),
    Claim(
        "4, 5",
        "“the MPO will gradually increase as the λ increases”",
        "E[P] rises with λ",
        Trend(POWER, DECAY_RATE, DECAY_RATES),
        GENERAL,
    ),
    *_claims(
        "4, 5",
        "“an increase in β will increase both the mean square output and MPO”",
        ("E[V²] rises with β", Trend(VOLTAGE, COUPLING, COUPLINGS), GENERAL),
        ("E[P] rises with β", Trend(POWER, COUPLING, COUPLINGS), GENERAL),
    ),
    Claim(
        "4, 5",
        "“mean square output and mean output power decreased with increasing τ1”",
        "E[V²] and E[P] fall with τ1",
        Trend(VOLTAGE, CORRELATION_TIME, (0.4, 1.0), rises=False),
        ((), JUMPING, *_each(GAP, 0.95, 1.25)),
    ),
    Claim(
        "4, 5",
        "“there is an optimal noise intensity to maximize PCE”",
        "PCE has a maximum inside the range of D",
        InteriorMaximum(EFFICIENCY, INTENSITY, INTENSITIES),
        STOPPERS,
    ),
    Claim(
        "4",
        "“the trajectory of the PCE curve is a downward parabola”",
        "PCE rises with D to its maximum, then falls",
        SingleHump(EFFICIENCY, INTENSITY, INTENSITIES),
        STOPPERS,
    ),
    *_claims(
        "4, 5",
        "“increases in parameters τ1 and K were detrimental to PCE, and increases in "
        "parameters δr and e promoted PCE”",
        (
            "PCE falls with τ1",
            Trend(EFFICIENCY, CORRELATION_TIME, CORRELATION_TIMES, rises=False),
            (*STOPPERS, JUMPING),
        ),
        (
            "PCE falls with K",
            Trend(EFFICIENCY, STIFFNESS, (1.0, 7.0, 13.0), rises=False),
            ALL_NOISES,
        ),
        ("PCE rises with δr", Trend(EFFICIENCY, GAP, (1.1, 1.2, 1.3)), ALL_NOISES),
        ("PCE rises with e", Trend(EFFICIENCY, RESTITUTION, (0.4, 0.7, 1.0)), ALL_NOISES),
    ),
    Claim(
        "4, 5",
        "“the theoretical analysis results are in good agreement with the numerical MC simulation”",
        "E[V²] and PCE within 10 % of Monte Carlo",
        Agreement((VOLTAGE, EFFICIENCY), 0.10),
        (*_each(INTENSITY, 0.005, 0.02, 0.08, 0.125), LONG),
    ),
)
