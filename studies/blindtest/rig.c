/* A reference rig of one magnetorheological damper, on a testing machine or in a shear frame of three storeys.
 *
 * It stands in for a laboratory: the blind test draws its records from here. It is written apart from the plugin
 * and shares nothing with it: classical Runge-Kutta of fourth order with a fixed step over one vector of ordinary
 * differential equations, the piston of a mount as a small mass, and other exact forms of the effects. Plays, relays
 * and strokes are updated between steps. SI units; the command in ampere or volt.
 *
 * A rig is a table of numbers, one per name in RIG_NUMBERS; zero is neutral for all that is not a law's parameter. */
#include <math.h>
#include <string.h>

static const double kPi = 3.14159265358979323846;

#define RIG_NUMBERS(X)                                                                                              \
  /* law: 0 bingham, 1 bouc_wen, 2 hyperbolic_tangent, 3 modified_bouc_wen, 4 sigmoid (hook_v, hook_x) */            \
  X(law) X(c0a) X(c0b) X(c1a) X(c1b) X(k0) X(k1) X(x0) X(alpha_a) X(alpha_b) X(gamma) X(beta) X(A) X(n) X(fya) X(fyb) \
  X(v_ref) X(k0a) X(k0b) X(k1a) X(k1b) X(m0) X(f0a) X(f0b)                                                          \
  X(hook_v) X(hook_x)                                                                                                 \
  /* what a law may have beside its form: a current map 1 S-shaped (logistic); elements that stick and slip in         \
   * parallel to it, their limit (N) and the part that grows with the field; a yield force that follows the rate,      \
   * 1 at once, 2 with a memory */                                                                                    \
  X(map_form) X(map_share) X(map_span) X(map_steep) X(map_centre)                                                      \
  X(slip_force) X(slip_field) X(slip_span) X(slip_travel) X(rate_form) X(rate_share) X(rate_v) X(rate_time)            \
  /* driver: 1 two poles, 2 voltage limit, 3 unequal rise (tau) and fall (tau2), 4 a coil (tau) under a controller    \
   * with gain, reset time (tau2) and a limited voltage (span), 5 a coil (tau2) whose solid core lets the field in      \
   * by diffusion (tau: the slowest pole) */                                                                          \
  X(lag_form) X(lag_tau) X(lag_tau2) X(lag_rate) X(lag_span) X(lag_gain) X(sag_share) X(sag_time) X(dead_zone)        \
  /* magnetics: saturation 1 Froehlich, 2 error function, 3 arc tangent; remanence 1 plays, 2 relays, 3 plays whose   \
   * loop closes at the tip, 4 Coleman and Hodgdon */                                                                 \
  X(sat_form) X(sat_level) X(rem_form) X(rem_width) X(rem_share) X(rem_span) X(bias_current)                          \
  X(pull_force) X(pull_x) X(pull_width)                                                                               \
  /* fluid: heating 1 Arrhenius with two bodies, 2 rational with one; shear thinning 1 Cross, 2 Eyring, 3 Carreau     \
   * and Yasuda with a rest of viscosity, 4 Quemada */                                                                \
  X(heat_form) X(heat_capacity) X(heat_loss) X(heat_body) X(heat_link) X(heat_visc) X(heat_yield)                     \
  X(thin_form) X(thin_v) X(thin_m) X(thin_rest)                                                                      \
  /* asymmetry 1 by velocity, 2 by pressure, 3 by velocity and the more the faster, 4 by a check valve that takes      \
   * its time; trapped gas 1 by stroke, 2 as a pocket that is pressed shut, 3 polytropic in series with the fluid,     \
   * 4 play that is taken up softly */                                                                                \
  X(asym_form) X(asym_share) X(asym_width) X(asym_v) X(asym_time)                                                     \
  X(gas_form) X(gas_loss) X(gas_stroke) X(gas_sign) X(gas_free) X(gas_force) X(bypass_force) X(bypass_v)              \
  X(wear_loss) X(wear_x) X(wear_width) X(relief_force) X(cavity_force) X(chatter_share) X(chatter_hz)                 \
  X(settle_loss) X(settle_path) X(poppet_share) X(poppet_force) X(poppet_time) X(peak_gain) X(peak_path)              \
  /* mechanics: spring 1 polytropic, 2 of any power, 3 gas on both sides, 4 exponential; seal 1 LuGre, 2 Dahl,         \
   * 3 Coulomb and Stribeck without a state, 4 elastic before it slides (Dupont), 5 with a memory of its film */       \
  X(spring_form) X(spring_f0) X(spring_length) X(spring_k) X(spring_end) X(spring_power) X(spring_other)              \
  X(seal_form) X(seal_coulomb) X(seal_static) X(seal_v) X(seal_slide) X(seal_time) X(bent_force) X(stop_k) X(stop_x)  \
  X(rub_force) X(rub_x) X(rub_width) X(rub_side)                                                                      \
  X(leak_k) X(leak_time) X(leak_length)                                                                               \
  /* mount: 1 spring and dashpot, 2 stiffening rubber, 3 pin with play, 4 the same with Hertz's contact, 5 of two     \
   * rates, 6 rubber that relaxes (Zener) */                                                                          \
  X(mount_form) X(mount_k) X(mount_c) X(mount_gap) X(mount_scale) X(mount_power) X(mount_loss) X(mount_time) X(mount_mass) \
  /* load cell of a frame under feedback: relative error of its sensitivity, time constant of its amplifier (s) */     \
  X(cell_gain) X(cell_lag)

typedef struct {
#define X(name) double name;
  RIG_NUMBERS(X)
#undef X
} Rig;

/* A storey and the floor on top of it, ground up. k3, c2: stiffness that bends with the drift, quadratic damping.
 * friction: 1 Coulomb, 2 Dahl, 3 elements that slip one after another (Iwan), 4 LuGre. gap, stop: pounding. yield:
 * force at which the storey yields. crack: loss of stiffness in one direction. slack, slack_share: a brace that carries
 * nothing within its clearance. bolt_*: a joint that slips at a drift of bolt_hold as far as its holes let it, bolt_gap
 * either way. hung_*: a mass that hangs from the floor by a spring and a dashpot, or with hung_gap
 * lies on it, rubs (hung_rub, m/s2) and hits its edges. rock_*, of storey 1 only: the foundation tilts; rock_mass and
 * rock_k by the height of a storey squared. */
#define STOREY_NUMBERS(X)                                                                                           \
  X(mass) X(stiffness) X(damping) X(k3) X(c2) X(friction_form) X(friction) X(friction_travel) X(friction_static)      \
  X(friction_v) X(gap) X(stop) X(yield) X(crack) X(slack) X(slack_share) X(bolt_hold) X(bolt_gap)                     \
  X(hung_mass) X(hung_hz) X(hung_ratio) X(hung_gap) X(hung_rub) X(rock_mass) X(rock_k) X(rock_ratio)

typedef struct {
#define X(name) double name;
  STOREY_NUMBERS(X)
#undef X
} Storey;

enum { kStoreys = 3, kPlays = 6, kRelays = 150, kPoles = 4 };
/* Places in the state vector: two currents, the core's poles, sag, law (2), fluid and body temperature, bristle, film,
 * piston, peak of the yield force after a turn, trapped gas, check valve, poppet, leaked length, rubber, structure of
 * the fluid, the frame. */
enum { I1, I2, CORE, SAG = CORE + kPoles, L1, L2, HEAT, BODY, BRISTLE, FILM, XP, VP, PEAK, GAS, CHECK, POPPET, LEAK, RUBBER,
       STIRRED, kDamper };
enum { FX = kDamper, FV = FX + kStoreys, FQ = FV + kStoreys, HX = FQ + 2 * kStoreys, HV = HX + kStoreys,
       RX = HV + kStoreys, RV, kStates };
/* Columns of a damper's run: load cell (N), fluid (N), current, field, temperature rise (K), piston (m). */
enum { kDamperColumns = 6, kFrameColumns = 2 * kStoreys + 5 };

/* What changes between steps only. */
typedef struct {
  double play[kPlays];
  double element[kPlays]; /* m, where those in parallel to the law stick */
  char relay[kRelays];
  int on;           /* relays */
  double start;     /* where the stroke began, m */
  double furthest;  /* that it has reached */
  int direction;    /* of the stroke */
  double pocket;    /* m that the trapped gas is pressed together */
  double magnet;    /* the core's field, as a current */
  double driven;    /* current that it was last seen with */
  double bolt[kStoreys];          /* m that a storey's joint has slipped */
  double joint[kStoreys][kPlays]; /* those of a storey's joint */
  int open;         /* poppet */
  double path;      /* m travelled in all */
  double time;
} Memory;

typedef struct {
  double load, fluid, heat, closed; /* closed: the fluid's force with the poppet shut */
} Force;

static double positive(double c) { return c > 0 ? c : 0; }
static double clip(double c, double low, double high) { return c < low ? low : c > high ? high : c; }
static double sign(double c) { return (c > 0) - (c < 0); }

/* --- driver and magnetics ---------------------------------------------------------------------------------------- */

/* Field in a solid cylinder: it comes in by the zeros j of J0, a share of 4 / j^2 each (Carslaw and Jaeger 1959). */
static const double kZeros[kPoles] = {2.404826, 5.520078, 8.653728, 11.791534};

static double core(const double *y) {
  double field = 0, all = 0;
  for (int k = 0; k < kPoles; ++k) field += y[CORE + k] / pow(kZeros[k], 2), all += 1 / pow(kZeros[k], 2);
  return field / all;
}

static double current(const Rig *r, const double *y, double u) {
  double i = r->lag_form == 1 ? y[I2] : r->lag_form ? y[I1] : u;
  if (r->lag_form == 5) i = core(y);
  if (r->sag_share > 0) i /= 1 + r->sag_share * y[SAG];
  return i;
}

static void drive(const Rig *r, const double *y, double u, double *dy) {
  if (r->lag_form == 1) {
    dy[I1] = (u - y[I1]) / r->lag_tau;
    dy[I2] = (y[I1] - y[I2]) / r->lag_tau2;
  } else if (r->lag_form == 2) {
    dy[I1] = r->lag_rate * tanh((u - y[I1]) / (r->lag_tau * r->lag_rate));
  } else if (r->lag_form == 3) {
    const double tau = fabs(u) > fabs(y[I1]) ? r->lag_tau : r->lag_tau2;
    dy[I1] = (u - y[I1]) / tau * (r->lag_span > 0 ? 1 + 0.5 * fabs(y[I1]) / r->lag_span : 1); /* an iron core */
  } else if (r->lag_form == 4) { /* voltages as the currents that they hold; I2: the controller's integral */
    const double error = u - y[I1], asked = r->lag_gain * error + y[I2], given = clip(asked, -r->lag_span, r->lag_span);
    dy[I1] = (given - y[I1]) / r->lag_tau;
    dy[I2] = asked != given && asked * error > 0 ? 0 : r->lag_gain * error / r->lag_tau2; /* no windup */
  } else if (r->lag_form == 5) {
    dy[I1] = (u - y[I1]) / r->lag_tau2;
    for (int k = 0; k < kPoles; ++k)
      dy[CORE + k] = (y[I1] - y[CORE + k]) / fmax(r->lag_tau * pow(kZeros[0] / kZeros[k], 2), 4e-5);
  }
  if (r->sag_share > 0) {
    const double i = current(r, y, u);
    dy[SAG] = (i * i - y[SAG]) / r->sag_time;
  }
}

static double saturate(const Rig *r, double i) {
  const double s = r->sat_level;
  if (r->sat_form == 1) return i / (1 + fabs(i) / s);
  if (r->sat_form == 2) return s * erf(0.5 * sqrt(kPi) * i / s);
  if (r->sat_form == 3) return s * (2 / kPi) * atan(i / (s * (2 / kPi)));
  return i;
}

static double play_width(const Rig *r, int k) { return r->rem_width * (k + 1) / kPlays; }
static double relay_centre(const Rig *r, int k) { return r->rem_span * (k + 0.5) / kRelays; }
static double relay_width(const Rig *r, int k) { return r->rem_width * (0.4 + 1.2 * ((k * 37) % kRelays) / kRelays); }

/* How far a loop is open: it closes towards the largest current. */
static double open_loop(const Rig *r, double i) { return 1 / (1 + pow(i / (0.7 * r->rem_span), 4)); }

/* Coleman and Hodgdon 1986 (Int. J. Eng. Sci. 24, 897) about a straight line, between two currents: the field
 * follows by the share that comes back and lags by rem_width in the end. */
static double drawn_along(const Rig *r, double magnet, double from, double to) {
  const double lag = sign(to - from) * r->rem_width, fade = exp(-(1 - r->rem_share) * fabs(to - from) / r->rem_width);
  return to - (lag + (from - magnet - lag) * fade);
}

static void magnetise(const Rig *r, Memory *m, double i) {
  if (r->rem_form == 4) m->magnet = drawn_along(r, m->magnet, m->driven, i);
  m->driven = i;
  if (r->rem_form == 1 || r->rem_form == 3)
    for (int k = 0; k < kPlays; ++k) m->play[k] = clip(m->play[k], i - play_width(r, k), i + play_width(r, k));
  if (r->rem_form == 2) {
    m->on = 0;
    for (int k = 0; k < kRelays; ++k) {
      if (i > relay_centre(r, k) + relay_width(r, k)) m->relay[k] = 1;
      if (i < relay_centre(r, k) - relay_width(r, k)) m->relay[k] = 0;
      m->on += m->relay[k];
    }
  }
}

static double field(const Rig *r, const Memory *m, double i) {
  double b = i;
  if (r->dead_zone > 0) b = sign(i) * positive(fabs(i) - r->dead_zone);
  if (r->rem_form == 1) { /* the field lags by the mean of the stops */
    double stops = 0;
    for (int k = 0; k < kPlays; ++k) stops += (i - m->play[k]) / kPlays;
    b -= r->rem_share * stops;
  } else if (r->rem_form == 2) {
    b = (1 - r->rem_share) * i + r->rem_share * r->rem_span * m->on / kRelays;
  } else if (r->rem_form == 3) { /* narrow plays weigh more */
    double stops = 0, all = 0;
    for (int k = 0; k < kPlays; ++k) stops += exp(-0.3 * k) * (i - m->play[k]), all += exp(-0.3 * k);
    b -= r->rem_share * open_loop(r, i) * stops / all;
  } else if (r->rem_form == 4) {
    b += m->magnet - i;
  }
  if (r->bias_current > 0) b = r->bias_current + fabs(b - r->bias_current); /* the law's numbers hold it */
  return saturate(r, b);
}

/* --- fluid ------------------------------------------------------------------------------------------------------- */

/* Elements in parallel that slip at travels up to `widest`, each with the same limit; 1 when all of them slip. */
static double slip_travel(double widest, int k) { return widest * (k + 1) / kPlays; }

static double slipping(const double *held, double x, double widest) {
  double force = 0;
  for (int k = 0; k < kPlays; ++k) force += clip((x - held[k]) / slip_travel(widest, k), -1, 1) / kPlays;
  return force;
}

static void slip(double *held, double x, double widest) {
  for (int k = 0; k < kPlays; ++k) {
    const double travel = slip_travel(widest, k);
    held[k] = clip(held[k], x - travel, x + travel);
  }
}

static double side(double v) { return v / sqrt(v * v + 1.6e-5); }

static double viscosity(const Rig *r, double heat, double v) {
  double factor = 1;
  if (r->heat_form == 1) factor = exp(r->heat_visc * (1 / (293 + heat) - 1 / 293.0));
  if (r->heat_form == 2) factor = 1 / (1 + r->heat_visc * heat);
  if (r->thin_form == 1) factor /= 1 + pow(fabs(v) / r->thin_v, r->thin_m);
  if (r->thin_form == 2 && v != 0) factor *= asinh(v / r->thin_v) * r->thin_v / v;
  if (r->thin_form == 3)
    factor *= r->thin_rest + (1 - r->thin_rest) * pow(1 + pow(fabs(v) / r->thin_v, 4), (r->thin_m - 1) / 4);
  if (r->thin_form == 4) { /* Quemada 1978 (Rheol. Acta 17, 632); thin_rest: what is left of the viscosity */
    const double root = sqrt(fabs(v) / r->thin_v), rest = sqrt(r->thin_rest);
    factor *= pow((rest + rest * root) / (rest + root), 2);
  }
  return factor;
}

static double yielding(const Rig *r, const Memory *m, double heat, double peak) {
  double factor = 1;
  if (r->heat_form) factor = positive(1 - r->heat_yield * heat);
  if (r->settle_loss > 0) factor *= 1 - r->settle_loss * exp(-m->path / r->settle_path);
  if (r->peak_gain > 0) factor *= (1 + r->peak_gain * peak) / (1 + 0.3 * r->peak_gain); /* 1 on average */
  return factor;
}

/* Of the field that the law's numbers were made for: the same at its ends, with a toe and a shoulder in between. */
static double mapped(const Rig *r, double b) {
  if (!r->map_form) return b;
  const double k = r->map_steep, part = b / r->map_span;
  const double low = 1 / (1 + exp(k * r->map_centre)), high = 1 / (1 + exp(-k * (1 - r->map_centre)));
  const double curve = (1 / (1 + exp(-k * (part - r->map_centre))) - low) / (high - low);
  return b + r->map_share * (r->map_span * curve - b);
}

/* Factor of the yield force: 1 at the velocity rate_v where it follows at once. */
static double by_rate(const Rig *r, const double *y, double v, double *dy) {
  if (!r->rate_form) return 1;
  const double rate = fabs(v) / (fabs(v) + r->rate_v);
  if (r->rate_form == 2) dy[STIRRED] = (rate - y[STIRRED]) / r->rate_time;
  return 1 + r->rate_share * 2 * ((r->rate_form == 2 ? y[STIRRED] : rate) - 0.5);
}

static double bouc_wen(const Rig *r, double z, double v) {
  const double w = pow(fabs(z), r->n - 1);
  return r->A * v - r->gamma * fabs(v) * z * w - r->beta * v * fabs(z) * w;
}

/* The law's own force without its accumulator spring; that one goes to *spring. */
static double law(const Rig *r, const double *y, double x, double v, double b, double thick, double firm,
                  double *spring, double *dy) {
  *spring = 0;
  const double c0 = positive(r->c0a + r->c0b * b) * thick;
  if (r->law == 0) return c0 * v + positive(r->fya + r->fyb * b) * firm * tanh(v / r->v_ref);
  if (r->law == 4) { /* Kwok et al. 2006, doi:10.1088/0964-1726/15/4/015: the place in the stroke shifts the velocity */
    *spring = r->k0 * (x - r->x0);
    const double ahead = v + r->hook_v * tanh(x / r->hook_x);
    return c0 * v + positive(r->fya + r->fyb * b) * firm * tanh(ahead / r->v_ref);
  }
  if (r->law == 1) {
    dy[L1] = bouc_wen(r, y[L1], v);
    *spring = r->k0 * (x - r->x0);
    return c0 * v + positive(r->alpha_a + r->alpha_b * b) * firm * y[L1];
  }
  if (r->law == 2) {
    const double k0 = positive(r->k0a + r->k0b * b), k1 = positive(r->k1a + r->k1b * b);
    const double c1 = positive(r->c1a + r->c1b * b), f0 = positive(r->f0a + r->f0b * b) * firm;
    const double force = k1 * (x - y[L1]) + c1 * (v - y[L2]);
    dy[L1] = y[L2];
    dy[L2] = (force - k0 * y[L1] - c0 * y[L2] - f0 * tanh(y[L2] / r->v_ref)) / r->m0;
    return force;
  }
  const double c1 = positive(r->c1a + r->c1b * b) * thick, alpha = positive(r->alpha_a + r->alpha_b * b) * firm;
  const double inner = (alpha * y[L1] + c0 * v + r->k0 * (x - y[L2])) / (c0 + c1);
  dy[L1] = bouc_wen(r, y[L1], v - inner);
  dy[L2] = inner;
  *spring = r->k1 * (x - r->x0);
  return c1 * inner;
}

/* What is lost or added on the way from the fluid to the rod. */
static double rod_share(const Rig *r, const Memory *m, const double *y, double x, double v, double force, double *dy) {
  if (r->asym_form == 1) force *= 1 + r->asym_share * side(v);
  if (r->asym_form == 2) force *= 1 + r->asym_share * force / (fabs(force) + r->asym_width);
  if (r->asym_form == 3) { /* a quarter of it whatever the speed */
    const double speed = fabs(v) / (fabs(v) + r->asym_v);
    force *= 1 + r->asym_share * side(v) * (0.25 + 0.75 * speed);
  }
  if (r->asym_form == 4) {
    dy[CHECK] = (tanh(force / r->asym_width) - y[CHECK]) / r->asym_time;
    force *= 1 + r->asym_share * y[CHECK];
  }
  if (r->gas_form == 1 && m->direction == r->gas_sign)
    force *= 1 - r->gas_loss * exp(-fabs(x - m->start) / r->gas_stroke);
  if (r->gas_form == 2 && v * r->gas_sign > 0) {
    const double open = 1 - m->pocket / r->gas_stroke;
    force *= 1 - r->gas_loss * open * open * tanh(fabs(v) / 0.002);
  }
  if (r->gas_form == 3) { /* the fluid flows by the share of its force that the gas holds against it */
    const double part = clip(y[GAS] / r->gas_stroke, 0, 0.99), held = r->gas_force * (pow(1 - part, -1.3) - 1);
    dy[GAS] = fabs(v) * (sign(r->gas_sign * force) - held / fmax(fabs(force), 0.05 * r->gas_force));
    if (y[GAS] <= 0) dy[GAS] = positive(dy[GAS]);
    force = r->gas_sign * held + (force * r->gas_sign > 0 ? 0 : force);
  }
  if (r->gas_form == 4) {
    const double way = clip((m->pocket / r->gas_stroke - r->gas_free) / (1 - r->gas_free), 0, 1);
    force *= 1 - r->gas_loss * (1 - way * way * (3 - 2 * way)) * 0.5 * (1 + side(r->gas_sign * v));
  }
  if (r->bypass_v > 0) { /* past the piston goes what an orifice lets through at less than the fluid's own force */
    const double orifice = r->bypass_force * pow(v / r->bypass_v, 2);
    force *= orifice / hypot(force, orifice + 1e-9);
  }
  if (r->wear_loss != 0) {
    const double d = (x - r->wear_x) / r->wear_width;
    force *= 1 - r->wear_loss * exp(-d * d);
  }
  if (r->chatter_share > 0) force *= 1 + r->chatter_share * tanh(fabs(v) / 0.02) * sin(2 * kPi * r->chatter_hz * m->time);
  if (r->relief_force > 0) force /= pow(1 + pow(fabs(force) / r->relief_force, 8), 0.125);
  if (r->cavity_force > 0 && force < 0) force = -r->cavity_force * tanh(-force / r->cavity_force);
  return force;
}

/* --- mechanics --------------------------------------------------------------------------------------------------- */

static double seal(const Rig *r, const double *y, double v, double *dy) {
  const double q = y[BRISTLE], s = (r->seal_form == 5 ? y[FILM] : v) / r->seal_v;
  double *dq = &dy[BRISTLE];
  const double limit = r->seal_coulomb * (1 + (r->seal_static - 1) * exp(-s * s));
  const double stiffness = r->seal_coulomb / r->seal_slide;
  if (r->seal_form == 3) return limit * (2 / kPi) * atan(v / (0.1 * r->seal_v));
  if (r->seal_form == 2) {
    *dq = v * (1 - stiffness * q / r->seal_coulomb * sign(v));
    return stiffness * q;
  }
  if (r->seal_form == 4) { /* Dupont et al. 2002, doi:10.1109/TAC.2002.1000274: elastic up to 0.7 of Coulomb's force */
    const double first = 0.7 * r->seal_coulomb / stiffness, full = limit / stiffness;
    const double way = clip((fabs(q) - first) / (full - first), 0, 1);
    const double slides = q * v > 0 ? 0.5 - 0.5 * cos(kPi * way) : 0;
    *dq = v * (1 - slides * sign(v) * q / full);
    return stiffness * q;
  }
  if (r->seal_form == 5) { /* the film is late for the velocity: Armstrong, Dupont, Canudas 1994 */
    dy[FILM] = (fabs(v) - y[FILM]) / r->seal_time;
    *dq = v * (1 - q * sign(v) / r->seal_slide);
    return limit * q / r->seal_slide;
  }
  *dq = v - stiffness * fabs(v) * q / limit;
  return stiffness * q + 0.1 * sqrt(stiffness) * *dq;
}

static double springs(const Rig *r, const double *y, double x, double *dy) {
  double force = 0;
  if (r->spring_form == 3) { /* gas behind the piston and before it */
    const double part = clip(x / r->spring_length, -0.8, 0.8);
    force += r->spring_f0 * (pow(1 - part, -1.2) - r->spring_other * pow(1 + part, -1.2));
  }
  if (r->spring_form == 4) { /* a coil that closes winding by winding */
    const double part = clip(x / r->spring_length, -4, 4);
    force += r->spring_f0 + r->spring_k * x + r->spring_end * (exp(part) - 1 - part);
  }
  if (r->leak_k > 0) { /* a spring that lets go through an orifice: by the root of its force */
    const double d = x - y[LEAK];
    dy[LEAK] = d / sqrt(fabs(d) / r->leak_length + 0.01) / r->leak_time;
    force += r->leak_k * d;
  }
  if (r->spring_form == 1) force += r->spring_f0 * pow(clip(1 - x / r->spring_length, 0.05, 20), -1.3);
  if (r->spring_form == 2) force += r->spring_f0 + r->spring_k * x + r->spring_end * sign(x) * pow(fabs(x) / r->spring_length, r->spring_power);
  if (r->stop_k > 0) force += sign(x) * r->stop_k * pow(positive(fabs(x) - r->stop_x), 1.5);
  return force;
}

/* Force at the piston, and what it does to the damper's states. */
static Force piston(const Rig *r, const Memory *m, const double *y, double x, double v, double b, double *dy) {
  double spring;
  Force f;
  if (r->peak_gain > 0) dy[PEAK] = (exp(-fabs(x - m->start) / r->peak_path) - y[PEAK]) / 0.003;
  const double thick = viscosity(r, y[HEAT], v);
  const double firm = yielding(r, m, y[HEAT], y[PEAK]) * by_rate(r, y, v, dy);
  const double felt = mapped(r, b);
  f.fluid = law(r, y, x, v, felt, thick, firm, &spring, dy);
  if (r->slip_force > 0) {
    const double limit = r->slip_force * (1 - r->slip_field + r->slip_field * 2 * felt / r->slip_span);
    f.fluid += positive(limit) * firm * slipping(m->element, x, r->slip_travel);
  }
  f.fluid = f.closed = rod_share(r, m, y, x, v, f.fluid, dy);
  if (r->poppet_share > 0) {
    dy[POPPET] = (m->open - y[POPPET]) / (m->open ? 0.004 : r->poppet_time);
    f.fluid *= 1 - r->poppet_share * y[POPPET];
  }
  f.load = f.fluid + spring + springs(r, y, x, dy);
  if (r->seal_form) f.load += seal(r, y, v, dy);
  if (r->pull_force != 0) {
    const double d = (x - r->pull_x) / r->pull_width;
    f.load += r->pull_force * b * b * d * exp(-d * d);
  }
  if (r->bent_force > 0) f.load += r->bent_force * fabs(x) * tanh(v / 0.002);
  if (r->rub_force > 0) { /* a guide that holds the rod towards one end */
    const double in = clip((r->rub_side * x - r->rub_x) / r->rub_width, 0, 1);
    f.load += r->rub_force * in * in * (3 - 2 * in) * tanh(v / 0.002);
  }
  f.heat = fabs(f.fluid * v);
  if (r->heat_form) {
    const double out = r->heat_form == 1 ? r->heat_link * (y[HEAT] - y[BODY]) : r->heat_loss * y[HEAT];
    dy[HEAT] = (f.heat - out) / r->heat_capacity;
    if (r->heat_form == 1) dy[BODY] = (out - r->heat_loss * y[BODY]) / r->heat_body;
  }
  return f;
}

static double mount(const Rig *r, double d, double rate, double q, double *dq) {
  if (r->mount_form == 5) {
    const double past = sign(d) * positive(fabs(d) - r->mount_scale);
    return r->mount_k * (d + (r->mount_power - 1) * past) + r->mount_c * rate;
  }
  if (r->mount_form == 6) { /* a second spring that lets go in its own time */
    *dq = rate - q / r->mount_time;
    return r->mount_k * (d + r->mount_loss * q) + r->mount_c * rate;
  }
  if (r->mount_form == 1) return r->mount_k * d + r->mount_c * rate;
  if (r->mount_form == 2) return r->mount_k * d * (1 + pow(fabs(d) / r->mount_scale, r->mount_power)) + r->mount_c * rate;
  const double depth = fabs(d) - 0.5 * r->mount_gap;
  if (depth <= 0) return 0;
  const double speed = rate * sign(d);
  const double force = r->mount_form == 3 ? r->mount_k * depth + r->mount_c * speed
                                          : r->mount_k * pow(depth, 1.5) * (1 + r->mount_c * speed);
  return sign(d) * positive(force);
}

/* The damper between two points that are x apart: its force on the load cell. */
static Force damper(const Rig *r, const Memory *m, const double *y, double x, double v, double u, double *dy) {
  drive(r, y, u, dy);
  const double b = field(r, m, current(r, y, u));
  if (!r->mount_form) return piston(r, m, y, x, v, b, dy);
  Force f = piston(r, m, y, y[XP], y[VP], b, dy);
  const double inner = f.load;
  f.load = mount(r, x - y[XP], v - y[VP], y[RUBBER], &dy[RUBBER]);
  dy[XP] = y[VP];
  dy[VP] = (f.load - inner) / r->mount_mass;
  return f;
}

/* force: the fluid's with the poppet shut, N. */
static void remember(const Rig *r, Memory *m, const double *y, double x, double v, double u, double force, double dt) {
  const double at = r->mount_form ? y[XP] : x, moved = r->mount_form ? y[VP] * dt : v * dt;
  m->time += dt;
  m->path += fabs(moved);
  if (r->slip_force > 0) slip(m->element, at, r->slip_travel);
  m->pocket = clip(m->pocket + r->gas_sign * moved, 0, r->gas_stroke);
  if (fabs(force) > r->poppet_force) m->open = 1;
  if (fabs(force) < 0.5 * r->poppet_force) m->open = 0;
  if (m->direction * (at - m->furthest) > 0) m->furthest = at;
  if (m->direction * (at - m->furthest) < -2e-5) { /* 20 um of way back make a turn */
    m->direction = -m->direction;
    m->start = m->furthest;
    m->furthest = at;
  }
  magnetise(r, m, current(r, y, u));
}

static void begin(const Rig *r, Memory *m, double *y, double x, double v, double u) {
  memset(m, 0, sizeof *m);
  memset(y, 0, kStates * sizeof *y);
  y[I1] = y[I2] = u;
  for (int k = 0; k < kPoles; ++k) y[CORE + k] = u;
  y[L2] = r->law == 3 ? x : 0;
  y[L1] = r->law == 2 ? x : 0;
  y[XP] = x;
  y[VP] = v;
  y[CHECK] = sign(v);
  y[FILM] = fabs(v);
  y[PEAK] = 1;
  y[LEAK] = x;
  m->direction = v < 0 ? -1 : 1;
  m->start = m->furthest = x;
  m->magnet = m->driven = u;
  y[STIRRED] = fabs(v) / (fabs(v) + fmax(r->rate_v, 1e-9));
  for (int k = 0; k < kPlays; ++k) m->element[k] = x;
  for (int k = 0; k < kPlays; ++k) m->play[k] = u; /* as after an alternating field that died out */
  magnetise(r, m, u);                              /* relays: risen from zero */
}

/* --- frame ------------------------------------------------------------------------------------------------------- */

typedef struct {
  const Rig *rig;
  const Storey *storey;
  int from, to;
} Frame;

static double storey_force(const Storey *s, const Memory *m, const double *y, int k, double d, double rate,
                           double *dy) {
  double stiffness = s->stiffness;
  d -= m->bolt[k];
  if (s->crack > 0 && d > 0) stiffness *= 1 - s->crack;
  const double bend = s->k3 * d * d; /* it takes or gives a quarter of the stiffness at most */
  double force = stiffness * d * (1 + bend / (1 + 4 * fabs(bend))) + s->damping * rate + s->c2 * fabs(rate) * rate;
  if (s->friction_form == 1) force += s->friction * tanh(rate / 5e-4);
  if (s->friction_form == 2) {
    dy[FQ + k] = rate * (1 - y[FQ + k] * sign(rate));
    dy[FQ + k] /= 6e-5;
    force += s->friction * y[FQ + k];
  }
  if (s->friction_form == 3) force += s->friction * slipping(m->joint[k], d, s->friction_travel);
  if (s->friction_form == 4) {
    const double v = rate / s->friction_v, limit = 1 + (s->friction_static - 1) * exp(-v * v);
    dy[FQ + k] = (rate - fabs(rate) * y[FQ + k] / limit) / s->friction_travel;
    force += s->friction * (y[FQ + k] + 1e-4 * dy[FQ + k]);
  }
  if (s->slack > 0) force -= s->slack_share * s->stiffness * clip(d, -s->slack, s->slack);
  if (s->yield > 0) { /* half of the stiffness is elastic, half flows */
    double *dq = &dy[FQ + kStoreys + k];
    const double q = y[FQ + kStoreys + k], limit = s->yield / (0.5 * s->stiffness);
    *dq = rate * (1 - 0.5 * (1 + sign(rate * q)) * pow(fabs(q) / limit, 2));
    force += 0.5 * s->stiffness * (q - d);
  }
  if (s->gap > 0) force += s->stop * positive(d - s->gap);
  return force;
}

/* What bends the storey, m. */
static double drift(const double *y, int k) { return y[FX + k] - (k ? y[FX + k - 1] : 0) - y[RX]; }

static void remember_joints(const Frame *f, Memory *m, const double *y) {
  for (int k = 0; k < kStoreys; ++k)
    if (f->storey[k].friction_form == 3) slip(m->joint[k], drift(y, k), f->storey[k].friction_travel);
  for (int k = 0; k < kStoreys; ++k) {
    const double hold = f->storey[k].bolt_hold, gap = f->storey[k].bolt_gap, d = drift(y, k);
    m->bolt[k] = clip(clip(m->bolt[k], d - hold, d + hold), -gap, gap);
  }
}

/* Absolute accelerations of the floors into acc; states are relative to the ground. */
static Force frame(const Frame *f, const Memory *m, const double *y, double ground, double u, double *dy, double *acc) {
  const double *x = y + FX, *v = y + FV;
  double load[kStoreys + 1] = {0}, moment = 0;
  for (int k = 0; k < kStoreys; ++k) {
    const double rate = v[k] - (k ? v[k - 1] : 0) - y[RV];
    const double force = storey_force(&f->storey[k], m, y, k, drift(y, k), rate, dy);
    load[k + 1] -= force;
    load[k] += force;
    moment += force;
  }
  const Storey *base = f->storey;
  if (base->rock_mass > 0) {
    const double dashpot = 2 * base->rock_ratio * sqrt(base->rock_k * base->rock_mass);
    dy[RX] = y[RV];
    dy[RV] = (moment - base->rock_k * y[RX] - dashpot * y[RV]) / base->rock_mass;
  }
  const double xa = f->from ? x[f->from - 1] : 0, xb = f->to ? x[f->to - 1] : 0;
  const double va = f->from ? v[f->from - 1] : 0, vb = f->to ? v[f->to - 1] : 0;
  const Force force = damper(f->rig, m, y, xb - xa, vb - va, u, dy);
  load[f->to] -= force.load;
  load[f->from] += force.load;
  for (int k = 0; k < kStoreys; ++k) {
    const Storey *s = &f->storey[k];
    if (s->hung_mass > 0) {
      const double w = 2 * kPi * s->hung_hz, d = y[HX + k] - x[k], rate = y[HV + k] - v[k];
      double pull = s->hung_mass * (w * w * d + 2 * s->hung_ratio * w * rate);
      if (s->hung_gap > 0) {
        const double depth = fabs(d) - s->hung_gap, hit = w * w * depth + 2 * s->hung_ratio * w * rate * sign(d);
        pull = s->hung_mass * (s->hung_rub * tanh(rate / 0.002) + (depth > 0 ? sign(d) * positive(hit) : 0));
      }
      load[k + 1] += pull;
      dy[HX + k] = y[HV + k];
      dy[HV + k] = -pull / s->hung_mass - ground;
    }
    acc[k] = load[k + 1] / s->mass;
    dy[FX + k] = v[k];
    dy[FV + k] = acc[k] - ground;
  }
  return force;
}

/* --- runs -------------------------------------------------------------------------------------------------------- */

/* Runge-Kutta's four stages; RATES(at, y, dy) with `at` counting half steps from here. */
#define RUNGE_KUTTA(h, size, y, RATES)                                                    \
  do {                                                                                    \
    double k1[kStates] = {0}, k2[kStates] = {0}, k3[kStates] = {0}, k4[kStates] = {0}, w[kStates]; \
    RATES(0, (y), k1);                                                                    \
    for (int j_ = 0; j_ < (size); ++j_) w[j_] = (y)[j_] + 0.5 * (h) * k1[j_];              \
    RATES(1, w, k2);                                                                      \
    for (int j_ = 0; j_ < (size); ++j_) w[j_] = (y)[j_] + 0.5 * (h) * k2[j_];              \
    RATES(1, w, k3);                                                                      \
    for (int j_ = 0; j_ < (size); ++j_) w[j_] = (y)[j_] + (h) * k3[j_];                    \
    RATES(2, w, k4);                                                                      \
    for (int j_ = 0; j_ < (size); ++j_)                                                   \
      (y)[j_] += (h) / 6 * (k1[j_] + 2 * k2[j_] + 2 * k3[j_] + k4[j_]);                    \
  } while (0)

#define EXPORT __attribute__((visibility("default")))

EXPORT int rig_names(char *text, int size) {
  static const char names[] =
#define X(name) #name " "
      RIG_NUMBERS(X) "| " STOREY_NUMBERS(X)
#undef X
      ;
  if (size < (int)sizeof names) return (int)sizeof names;
  memcpy(text, names, sizeof names);
  return 0;
}

/* x, v, u: (2 n - 1,) at half steps. out: (n, 6). Returns the step at which a number stopped being finite, or -1. */
EXPORT long rig_damper(const double *numbers, double h, long n, const double *x, const double *v, const double *u,
                       double *out) {
  const Rig *r = (const Rig *)numbers;
  double y[kStates];
  Memory m;
  begin(r, &m, y, x[0], v[0], u[0]);
  for (long k = 0; k < n; ++k) {
    const long at = 2 * k;
    double rest[kStates] = {0};
    const Force f = damper(r, &m, y, x[at], v[at], u[at], rest);
    double *row = out + kDamperColumns * k;
    row[0] = f.load, row[1] = f.fluid, row[2] = current(r, y, u[at]);
    row[3] = field(r, &m, row[2]), row[4] = y[HEAT], row[5] = r->mount_form ? y[XP] : x[at];
    if (!isfinite(f.load) || !isfinite(y[XP])) return k;
    if (k == n - 1) break;
#define RATES(i, state, rate) damper(r, &m, state, x[at + (i)], v[at + (i)], u[at + (i)], rate)
    RUNGE_KUTTA(h, kDamper, y, RATES);
#undef RATES
    remember(r, &m, y, x[at + 2], v[at + 1], u[at + 2], f.closed, h);
  }
  return -1;
}

/* storeys: (3, numbers of a storey). ground (m/s2), u: (2 n - 1,) at half steps. out: (n, 11): absolute accelerations,
 * displacements to the ground, force on the structure's load cell, stroke, current, field, temperature rise. */
EXPORT long rig_frame(const double *numbers, const double *storeys, int from, int to, double h, long n,
                      const double *ground, const double *u, double *out) {
  const Frame f = {(const Rig *)numbers, (const Storey *)storeys, from, to};
  double y[kStates], acc[kStoreys], scratch[kStoreys];
  Memory m;
  begin(f.rig, &m, y, 0, 0, u[0]);
  for (long k = 0; k < n; ++k) {
    const long at = 2 * k;
    double rest[kStates] = {0};
    const Force force = frame(&f, &m, y, ground[at], u[at], rest, acc);
    double *row = out + kFrameColumns * k;
    memcpy(row, acc, sizeof acc);
    memcpy(row + kStoreys, y + FX, kStoreys * sizeof *y);
    row[2 * kStoreys] = force.load;
    row[2 * kStoreys + 1] = (to ? y[FX + to - 1] : 0) - (from ? y[FX + from - 1] : 0);
    row[2 * kStoreys + 2] = current(f.rig, y, u[at]);
    row[2 * kStoreys + 3] = field(f.rig, &m, row[2 * kStoreys + 2]);
    row[2 * kStoreys + 4] = y[HEAT];
    if (!isfinite(force.load) || !isfinite(acc[0]) || !isfinite(y[XP])) return k;
    if (k == n - 1) break;
#define RATES(i, state, rate) frame(&f, &m, state, ground[at + (i)], u[at + (i)], rate, scratch)
    RUNGE_KUTTA(h, kStates, y, RATES);
#undef RATES
    const double stroke = (to ? y[FX + to - 1] : 0) - (from ? y[FX + from - 1] : 0);
    const double speed = (to ? y[FV + to - 1] : 0) - (from ? y[FV + from - 1] : 0);
    remember(f.rig, &m, y, stroke, speed, u[at + 2], force.closed, h);
    remember_joints(&f, &m, y);
  }
  return -1;
}

/* What a controller sees at a time (s): a row of the frame's columns, then the stroke's velocity. Gives the command. */
typedef double (*Controller)(double time, const double *row);

/* The frame under feedback: the controller is asked every `every` steps and its command held in between. The force is
 * that of the load cell. u: (n,) the commands. Otherwise as rig_frame. */
EXPORT long rig_frame_controlled(const double *numbers, const double *storeys, int from, int to, double h, long n,
                                 const double *ground, long every, Controller controller, double *u, double *out) {
  const Frame f = {(const Rig *)numbers, (const Storey *)storeys, from, to};
  double y[kStates], acc[kStoreys], scratch[kStoreys], seen[kFrameColumns + 1], held = 0, cell = 0;
  Memory m;
  begin(f.rig, &m, y, 0, 0, 0);
  for (long k = 0; k < n; ++k) {
    const long at = 2 * k;
    double rest[kStates] = {0}, *row = out + kFrameColumns * k;
    const Force force = frame(&f, &m, y, ground[at], held, rest, acc);
    const double speed = (to ? y[FV + to - 1] : 0) - (from ? y[FV + from - 1] : 0);
    memcpy(row, acc, sizeof acc);
    memcpy(row + kStoreys, y + FX, kStoreys * sizeof *y);
    const double asked = (1 + f.rig->cell_gain) * force.load;
    cell = f.rig->cell_lag > 0 && k > 0 ? asked + (cell - asked) * exp(-h / f.rig->cell_lag) : asked;
    row[2 * kStoreys] = cell;
    row[2 * kStoreys + 1] = (to ? y[FX + to - 1] : 0) - (from ? y[FX + from - 1] : 0);
    row[2 * kStoreys + 2] = current(f.rig, y, held);
    row[2 * kStoreys + 3] = field(f.rig, &m, row[2 * kStoreys + 2]);
    row[2 * kStoreys + 4] = y[HEAT];
    if (!isfinite(force.load) || !isfinite(acc[0]) || !isfinite(y[XP])) return k;
    if (k % every == 0) {
      memcpy(seen, row, kFrameColumns * sizeof *row);
      seen[kFrameColumns] = speed;
      held = controller((double)k * h, seen);
    }
    u[k] = held;
    if (k == n - 1) break;
#define RATES(i, state, rate) frame(&f, &m, state, ground[at + (i)], held, rate, scratch)
    RUNGE_KUTTA(h, kStates, y, RATES);
#undef RATES
    const double stroke = (to ? y[FX + to - 1] : 0) - (from ? y[FX + from - 1] : 0);
    const double rate = (to ? y[FV + to - 1] : 0) - (from ? y[FV + from - 1] : 0);
    remember(f.rig, &m, y, stroke, rate, held, force.closed, h);
    remember_joints(&f, &m, y);
  }
  return -1;
}
