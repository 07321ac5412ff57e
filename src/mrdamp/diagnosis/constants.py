"""Constants that decide an answer, each with how it was set.

Constants that only set the computational effort are defined in the modules that use them.
"""

from __future__ import annotations

from collections.abc import Mapping

#: Evidence of a set of causes (conditional logit, `evidence.established`): nats per logarithm of what is left of the
#: squares in a cell on left-out data, and the penalties of a cause, of a second cause, of each parameter, and of
#: wrong nominal parameters if baseline records determine them; without a baseline they count as a cause. Set on 37
#: opened cases: 18 measured rigs as they are, 8 measured sets with an injected effect, 11 rigs with another law. Their
#: log likelihood is -31 at a gain of 16, -28 to -31 from 20 to 40 with penalties of 3.5 to 6, and -34 to -50 with 8;
#: the largest penalty of the flat part invents least. The 15 open cases in which the law is exact are all right with
#: these values, which were not set on them.
EVIDENCE_GAIN, CAUSE, SECOND_CAUSE, NUMBER, LAW = 30.0, 6.0, 3.0, 0.45, 28.0
#: Nats per logarithm of what is left of the squared error of the travel after a turn (`fits.stall`). On ten opened
#: cases of a friction damper with a clearance the answer is the same from 3 to 8. Of 151 opened searches fourteen lack
#: a travel that is a cause by itself (CAUSE): thirteen have a clearance, one a pocket of gas.
STALL_GAIN = 5.0
#: Scale of the prior (inverse gamma) of the variance of the law's error in a cell, as a share of the mean over the
#: cells that the best fit leaves (`fits.left_out.ratio`): a cell that the simulator fits already has no say. The open
#: cases have the same answers from .05 to .3.
CELL_SCALE = 0.1
#: Temperature of the stated probabilities: that of a set of causes is taken to the power 1 / TEMPER. The decision uses
#: the probability without it.
TEMPER = 1.3
#: The same of the stages of an unknown cause (`attribution.stage_evidence`), unless baseline records show that the law
#: is the rig's. On 25 opened cases the log likelihood of the right stage is -38 without it, -26 to -25 from 2 to 3, -26
#: at 4; of equal shares -44.
STAGE_TEMPER = 2.5
#: The verdict is "no gap" up to this multiple of the noise floor, if no cause is established.
NONE_ABOVE = 1.75
#: Free nominal parameters that leave more than this share of the excess have the wrong form.
UNKNOWN_ABOVE = 0.12
#: Additional penalty (nats) of a cause outside the catalogue: such causes are rarer than the catalogue's.
OUTSIDE_PENALTY = 1.5
#: A mount that is so many times as stiff under the force as without is a clearance. In four opened measured sets whose
#: clearance was named as a mount the factor is 11 (the largest of that form) or above 100; in the rigs with a compliant
#: mount it is at most 4.
CLEARANCE = 7.0
#: A clearance whose half is less than this multiple of the travel that its ends give way by is a mount that hardens:
#: .12 and .19 in two opened measured sets whose hardening mount was named as a clearance, 1.9 to 400 in fourteen with a
#: clearance.
ELASTIC = 0.6
#: Share of answers that are wrong for a reason that none of the fits contains, such as a form that the
#: catalogue lacks: 6 of 337 answers with a probability above .9 in two sealed tests that have since been
#: opened.
LAPSE = 0.02
#: The same share if no fit reaches the noise: of an answer without a cause, and of a cause that makes the gap larger
#: in a regime (`evidence.consistency`). In opened cases with another law 63 of 78 and 20 of 37 of these answers were
#: right, with stated probabilities of .92 and .85 in the mean.
LAPSE_INEXACT, LAPSE_WORSE = 0.11, 0.35
#: Probability of an unknown cause if two runs of one test differ by more than their noise and no cause is
#: found: no set of parameters explains that. In 400 opened cases of the sealed test this occurred in eight
#: with a cause outside the catalogue, and in none with wrong parameters alone or without a gap.
UNSTEADY = 0.9
#: For two channels that measure the same quantity, and for the balances of a frame's storeys and accelerometers: the
#: share of the squared difference beyond the noise that a cause may leave, and the resolution (multiple of the noise,
#: and per cent of the second channel) below which no cause is reported. In 28 opened cases the right cause left at most
#: .018 (one .06, found without the comparison too), a cause outside the catalogue .07 to 1.
DIRECT_LEFT, DIRECT_RESOLUTION = 0.05, 0.5

#: If every fit's cost is above this multiple of the noise's, the law is not the rig's or the cause is not in
#: the catalogue: the search is narrower, and the answer says so. Two runs of one test whose squared difference is above
#: it do not repeat. The value is an error of twice the noise.
INEXACT = 4.0
#: Effects that add a hysteresis that a law lacks: play and phase to Bingham's, one that does not depend on the rate to
#: the hyperbolic tangent's. If such a law is wrong, any law with that hysteresis fits as well, so these effects have
#: the penalty of free nominal parameters unless baseline records determine the law.
LOOPS: Mapping[str, frozenset[str]] = {
    "bingham": frozenset({"mount_compliance", "backlash", "channel_shift", "sensor_lag", "seal_friction"}),
    "hyperbolic_tangent": frozenset({"seal_friction"}),
}
#: Effects with nearly the same signature in every test; neither is evidence against the other. Delay and lag
#: overlap by .90 to .98 in nearly all records; a stiff spring and a small clearance, a preload and an offset, and a
#: displacement that is late or filtered are the other pairs.
TIED_BY_NATURE = (
    frozenset({"driver_lag", "command_delay"}),
    frozenset({"mount_compliance", "backlash"}),
    frozenset({"gas_spring", "sensor_offset"}),
    frozenset({"channel_shift", "motion_lag"}),
)
#: If a model of the same inputs predicts more than this share of the residual on left-out records, the
#: residual is an error of the law.
PREDICTABLE = 0.15
#: A cause is named, and a correction without one handed over, if it takes at least this share of the nominal squares
#: off on left-out folds. An effect that makes the gap 1.2 times as large (the smallest of the benches) is .3 of the
#: squares; two causes that were invented on opened controls took .03 and .10.
MATERIAL = 0.15
#: The law identified again on the baseline is used if its gap on baseline records outside its fit is below this
#: share of the given simulator's. On 24 opened rigs of the misfit bench the share was .08 to .76 if another law
#: or a curved dependence on the command was the rig's, and .87 to 1 otherwise.
BASELINE_LAW_BETTER = 0.8

#: Causes of a frame's damper that another law can stand in for. One is not named if another law, identified on the
#: records themselves, leaves less than LAW_NEEDLESS of the cost. Opened rigs with another law: .01 to .31 in five
#: frames where shear thinning was named and is not the cause, 1.2 in one where it is; .02 and .15 in two where heating
#: was named and is not the cause.
LAW_FORMS, LAW_NEEDLESS = frozenset({"shear_thinning", "heating"}), 0.4

# The constants below were set on opened cases of sealed tests in which the law is exactly the simulator's.

#: Number of independent samples that the error of a direct comparison of channels, or of a model of a stage's error,
#: counts for.
INDEPENDENT = 14.0
#: A measured current has the command's unit if the ratio of their sizes is within SAME_UNIT.
SAME_UNIT = (0.8, 1.25)
#: Two causes are tied if the rival's probability exceeds TIE_PROBABLE, or if the cosine of their changes exceeds
#: TIE_COSINE and the rival's cost is at most NONE_ABOVE times the named one's (at least the noise).
TIE_COSINE, TIE_PROBABLE = 0.98, 0.1
#: Records cannot show a cause whose signature, at the starting value of its parameter or at the fitted one, is below
#: this multiple of the remaining error.
HIDDEN_BELOW = 0.1
#: A frame's block is faulty if its gap exceeds this multiple of its noise.
BLOCK_FAULT = 1.35
#: The same number for an error that is intermittent, as far as no model explains it. Of 15 opened dampers with a cause
#: that neither the catalogue nor a rival has, the stage is right in 14 from 14 to 200.
WAVERING = 50.0
#: Stages whose errors are commonly random in time, and the penalty (nats) of a random error in another stage.
RANDOM_STAGES, RANDOM_PENALTY = ("driver", "fluid", "sensor"), 1.0
#: Least scatter (relative) of nominal masses and stiffnesses; factor of it for damping; number of independent
#: samples for their standard errors.
STRUCTURE_SCATTER, DAMPING_SCATTER, STRUCTURE_SAMPLES = 0.015, 5.0, 300.0
#: Least relative change of a structural parameter that counts as an effect (for damping, times DAMPING_SCATTER).
STRUCTURE_CHANGE = 0.06
