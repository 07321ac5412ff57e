/* mrdamp: magnetorheological damper, plain C interface (no MuJoCo needed).
 *
 * This header and the MuJoCo plugin run the same chain.
 * SI units; x, v: piston displacement and velocity, extension positive; the
 * damper force is positive when the rod is driven with v > 0.
 *
 * Parameters travel as one vector of mrdamp_attribute_count() doubles in the order
 * of the attribute table (core/attributes.def); mrdamp_defaults() fills the neutral
 * values. Functions that can fail return 0 on success and otherwise write one line to
 * err (at most err_size bytes, always terminated).
 */
#ifndef MRDAMP_H_
#define MRDAMP_H_

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define MRDAMP_API __attribute__((visibility("default")))
#else
#define MRDAMP_API
#endif

/* ---- the attribute table ------------------------------------------------------- */
MRDAMP_API int mrdamp_abi(void);              /* version of this interface: 14 */
MRDAMP_API int mrdamp_attribute_count(void);
MRDAMP_API const char* mrdamp_attribute_name(int i);
MRDAMP_API const char* mrdamp_attribute_group(int i);
MRDAMP_API const char* mrdamp_attribute_unit(int i);
MRDAMP_API const char* mrdamp_attribute_meaning(int i);
MRDAMP_API double mrdamp_attribute_default(int i);  /* NaN: not given */
MRDAMP_API double mrdamp_attribute_min(int i);
MRDAMP_API double mrdamp_attribute_max(int i);
MRDAMP_API int mrdamp_law_count(void);
MRDAMP_API const char* mrdamp_law_name(int law);
MRDAMP_API int mrdamp_law_find(const char* name);    /* -1: unknown */
/* 1: the law requires attribute i; 2: it is optional; 0: it is not used */
MRDAMP_API int mrdamp_law_uses(int law, int i);
/* rest of a law's row: equations; parameters, behind a bar the optional ones; start and bounds of a fit; keys of sources */
MRDAMP_API const char* mrdamp_law_equations(int law);
MRDAMP_API const char* mrdamp_law_parameters(int law);
MRDAMP_API const char* mrdamp_law_search(int law);
MRDAMP_API const char* mrdamp_law_sources(int law);
/* key, authors, title, journal, year, volume, pages, doi, with tabs between; NULL behind the last source */
MRDAMP_API const char* mrdamp_source(int i);
/* name (group of its attributes), stage, what it does, equations, in the same way, in the order of the chain */
MRDAMP_API const char* mrdamp_effect(int i);
MRDAMP_API void mrdamp_defaults(double* params);
/* checks ranges and the parameters required by the law, as in MJCF */
MRDAMP_API int mrdamp_check(int law, const double* params, char* err, int err_size);

/* ---- NARX networks ------------------------------------------------------------- */
typedef struct mrdamp_narx mrdamp_narx;
/* text of a weights file (format: plugin_cpp/README.md); NULL and a line on failure */
MRDAMP_API mrdamp_narx* mrdamp_narx_parse(const char* text, char* err, int err_size);
MRDAMP_API void mrdamp_narx_free(mrdamp_narx* net);
MRDAMP_API double mrdamp_narx_sample_time(const mrdamp_narx* net);
MRDAMP_API int mrdamp_narx_inputs(const mrdamp_narx* net);
/* one pass: inputs (physical units, in the order of the file's `inputs` line) -> force */
MRDAMP_API double mrdamp_narx_forward(const mrdamp_narx* net, const double* in);

/* ---- a record through the chain -------------------------------------------------- */
enum {                     /* columns of the output */
  MRDAMP_FORCE = 0,        /* N: force at the rod end (moving mass included) as the sensor with its effects reads it */
  MRDAMP_REFERENCE = 1,    /* N: the same force on an ideal load cell */
  MRDAMP_TRUE = 2,         /* N: force of the damper alone, without the moving mass */
  MRDAMP_CURRENT = 3,      /* coil current (command units) */
  MRDAMP_FIELD = 4,        /* field variable after saturation and remanence */
  MRDAMP_TEMPERATURE = 5,  /* K: rise of the fluid's temperature */
  MRDAMP_PISTON = 6,       /* m: piston displacement behind the mount */
  MRDAMP_STATE = 7,        /* the law's own state: z, or g, or 0 */
  MRDAMP_COLUMNS = 8
};

typedef struct {
  int hold;        /* 1: the command is constant between samples (as in MuJoCo); 0: linear */
  int threads;     /* that share the parameter sets; <= 1: none */
  double substep;  /* s: overrides the attribute where > 0 */
  int run_in;      /* 1: a record of mrdamp_run that begins in motion is led into by motion of its own, see there */
  int lanes;       /* sets that a core steps at once, at most: 1, 2, 4, 8; 0: what its vector units take */
} mrdamp_options;

/* nset parameter vectors, each through the whole record.
 *   params  nset x mrdamp_attribute_count()
 *   dt      s, sample time;  n samples of x (m), v (m/s, NULL: differentiated from x),
 *           a (m/s2, NULL: differentiated from v, used by moving_mass only), u (command)
 *   columns ncol of the enum above;  out  nset x ncol x n
 * With run_in the damper does not start at rest where the first 20 ms move: the part of the record before the sample
 * that is most like its first one, over twice the stroke to and fro, is run before. Else it starts at rest.
 * Results do not depend on the numbers of threads and lanes. */
MRDAMP_API int mrdamp_run(int law, const mrdamp_narx* net, int nset, const double* params, double dt,
                          int n, const double* x, const double* v, const double* a, const double* u,
                          const mrdamp_options* options, int ncol, const int* columns, double* out,
                          char* err, int err_size);

/* The same for several records at once, each with its own sets: they share the threads and the lanes. */
typedef struct {
  int nset, n;
  double dt, substep;                 /* s; substep <= 0: the attribute */
  int hold, run_in;                   /* as in mrdamp_options */
  const double *params, *x, *v, *a, *u;
  double* out;                        /* nset x ncol x n */
} mrdamp_record;
MRDAMP_API int mrdamp_run_records(int law, const mrdamp_narx* net, int nrecord, const mrdamp_record* records, int threads,
                                  int lanes, int ncol, const int* columns, char* err, int err_size);

/* The samples of the run-in of a record, from < to; from == to where it begins at rest. v as above. */
MRDAMP_API int mrdamp_run_in(double dt, int n, const double* x, const double* v, const double* u, int* from, int* to, char* err,
                             int err_size);

/* The motion x (m), v (m/s), a (m/s2), n samples each, that a channel with these attributes of channel_shift and motion_lag
 * has recorded as x, v, a. */
MRDAMP_API void mrdamp_true_motion(double shift_d, double lag_tau, double lag_width, double dt, int n, double* x, double* v,
                                   double* a);

/* ---- a shear frame with the damper in it ------------------------------------------- */
typedef struct {
  int storeys;
  const double* mass;      /* kg, floor 1 .. storeys */
  const double* stiffness; /* N/m, storey 1 (ground to floor 1) .. storeys */
  const double* damping;   /* N s/m */
  const double* friction;  /* N, dry friction per storey; NULL: none */
  int damper_from, damper_to; /* floors of its ends, 0 the ground; damper_to < 0: no damper */
  /* per floor accelerometer, NULL: ideal: gain, offset (m/s2), leakage (s, high-pass; 0 none), lag (s), its second
   * pole (s) */
  const double* acc_gain;
  const double* acc_offset;
  const double* acc_leakage;
  const double* acc_lag;
  const double* acc_lag2;
  const double* friction_width; /* m/s, width of the sign change of dry friction; NULL, 0: presliding instead */
  const double* friction_presliding; /* m, presliding drift; NULL, 0: 10 um */
  /* Nonlinear storeys, for causes outside the catalogue; the plugin has no attributes for them. Additional force per
   * storey as a function of the drift x; NULL, 0: none. */
  const double* one_sided; /* N/m: one_sided x while x is positive, above minus the stiffness */
  const double* cubic;     /* N/m3: cubic x^3 */
  const double* damping2;  /* N s2/m2 per storey, damping2 |v| v in addition to damping v; NULL, 0: none */
  /* per floor accelerometer, NULL: none: share of the charge with another leakage time constant, that (s; 0: no
   * leakage), damping ratio of a second-order lag in place of the first pole (0: first order) */
  const double* acc_leakage_share;
  const double* acc_leakage2;
  const double* acc_ratio;
  /* per floor accelerometer: additional offset that decays from the start (m/s2; NULL, 0: none), its time constant (s;
   * NULL, 0: 1) */
  const double* acc_settle;
  const double* acc_settle_time;
  /* A foundation that sways and rocks, for causes outside the catalogue; stiffness 0: rigid. Rocking of a frame with
   * storeys of equal height h as the drift that it adds to every storey (m): inertia I / h^2 (kg), stiffness
   * k / h^2 (N/m), damping c / h^2 (N s/m). Floor displacements contain both. */
  double sway_mass, sway_stiffness, sway_damping;
  double rock_mass, rock_stiffness, rock_damping;
} mrdamp_frame;

/* Frame columns: floor accelerations (absolute, through their sensors) 1..N, floor displacements
 * (to the ground) 1..N, then FORCE, TRUE, stroke (m), stroke velocity (m/s), CURRENT, FIELD,
 * TEMPERATURE: 2 N + 7. out: nset x (2 N + 7) x n. One frame per set (frames[nset]). */
MRDAMP_API int mrdamp_run_frame(int law, const mrdamp_narx* net, int nset, const double* params,
                                const mrdamp_frame* frames, double dt, int n, const double* ground_acceleration,
                                const double* u, const mrdamp_options* options, double* out, char* err, int err_size);

/* ---- rows of closed loops, a control period at a time ------------------------------------ */
/* n copies of one structure with dampers, each with its own load and commands, for controllers of many at once. A row's
 * state is mrdamp_rows_size() doubles of the caller, complete except for loads and commands; copying them copies the
 * row. */
typedef struct mrdamp_rows mrdamp_rows;

typedef struct {
  int count;                     /* of dampers, 1 or more */
  const int* law;                /* of each */
  const mrdamp_narx* const* net; /* of each, NULL for none; must outlive the rows */
  const double* params;          /* count x mrdamp_attribute_count() */
  const double* command_max;     /* of each, reference of the currents in the criteria */
} mrdamp_dampers;

/* Any linear structure q'' = rate [q; q'] + load w + push f, where f (N) is the tension of the dampers. */
typedef struct {
  int coordinates, loads;
  const double* rate;   /* coordinates x 2 coordinates */
  const double* load;   /* coordinates x loads */
  const double* stroke; /* dampers x coordinates: elongation per unit of the coordinates */
  const double* push;   /* coordinates x dampers */
  int places;           /* where motion is measured */
  const double* at;     /* places x coordinates, m per unit of each coordinate */
  int grounds;          /* of the loads, from the first on: accelerate the ground that coordinates are relative to */
  double mass;          /* reference of the mean squares of all coordinates; 0: criteria of each place instead */
} mrdamp_linear;

/* A quarter car: a frame of two floors, wheel and body, on the road as the ground, with one damper between the two. The
 * tension of the tyre is limited to the weight, at which the wheel lifts off. */
typedef struct {
  double body, wheel;                  /* kg */
  double stiffness, damping;           /* of the suspension: N/m, N s/m */
  double tyre_stiffness, tyre_damping; /* N/m, N s/m */
  double weight;                       /* N, static load of the tyre */
  int sections;                        /* of the filter of the body's acceleration, 1 or more */
  const double* weighting;             /* sections x 5: b0 b1 b2 a1 a2, at the rows' step */
} mrdamp_car;

/* Load of a row: samples x loads, linear between samples, constant after the last one, zero from step `steps` on.
 * Loads: the ground's acceleration (m/s2) of a frame, the road's of a car, w of a linear structure. */
typedef struct {
  const double* values;
  double sample_time; /* s */
  int samples, steps;
} mrdamp_load;

/* Criteria of a control period. Of a frame: largest |drift| (m) and |absolute acceleration| (m/s2) at `instants` instants of
 * every step, evenly from its start. Of a linear structure: sums of squares of the coordinates, at the steps' ends, and of
 * their accelerations, at their starts, over mass and steps (m2, m2/s4); or of each place at the steps' starts the mean squares
 * of its acceleration, the largest |acceleration|, and both of its displacement: 4 x places in place of 2. Then, as means over dampers and those instants,
 * |current| over command_max, its square, |current|; and the energy taken in by the dampers (J). NaN where the motion
 * diverged. */
enum { MRDAMP_CRITERIA = 6 };
/* Of a car, over the starts of the period's steps: mean squares of the filtered acceleration (m2/s4), of the load on the tyre
 * over the weight less one, of the stroke (m2); largest |stroke| (m); share of them without contact; then the last four above. */
enum { MRDAMP_CAR_CRITERIA = 9 };

/* Measurements of a linear structure: accelerations, displacements, velocities at the places. Of a frame: absolute accelerations
 * through their sensors, displacements and velocities to the ground of every floor, drifts of every storey. Then, by
 * damper: FORCE, REFERENCE, stroke, its velocity, CURRENT. An accelerometer is read once in a control period.
 * between: count pairs of floors. period (s) is divided into `steps` steps, each of which is one inner step of the chain.
 * NULL and a line on failure. The frame's own damper_from, damper_to are ignored. */
MRDAMP_API mrdamp_rows* mrdamp_rows_frame(const mrdamp_frame* frame, const mrdamp_dampers* dampers, const int* between,
                                          double period, int steps, int instants, char* err, int err_size);
MRDAMP_API mrdamp_rows* mrdamp_rows_linear(const mrdamp_linear* linear, const mrdamp_dampers* dampers, double period, int steps,
                                           char* err, int err_size);
/* Measurements and commands as of a frame of two floors; `instants` is ignored. */
MRDAMP_API mrdamp_rows* mrdamp_rows_car(const mrdamp_car* car, const mrdamp_dampers* dampers, double period, int steps,
                                        int instants, char* err, int err_size);
MRDAMP_API void mrdamp_rows_free(mrdamp_rows* rows);
MRDAMP_API int mrdamp_rows_size(const mrdamp_rows* rows);         /* doubles of a row's state; coordinates begin at 3, then
                                                                   * their velocities */
MRDAMP_API int mrdamp_rows_measurements(const mrdamp_rows* rows);
MRDAMP_API int mrdamp_rows_criteria(const mrdamp_rows* rows); /* of a row */
/* Sets white noise on every measurement: standard deviations, mrdamp_rows_measurements() of them. */
MRDAMP_API int mrdamp_rows_noise(mrdamp_rows* rows, const double* deviation, char* err, int err_size);
/* From now on a control period also writes the measurements at the start of each of its steps, without noise and the
 * accelerometers' errors, under its command: rows x steps x mrdamp_rows_measurements(). NULL: no more. */
MRDAMP_API void mrdamp_rows_within(mrdamp_rows* rows, double* within);
/* A row at rest; seed, a whole number below 2^53: of its noise. Writes its state and measurements. Before the first
 * command the dampers have none, or their command_start. */
MRDAMP_API void mrdamp_rows_start(const mrdamp_rows* rows, double seed, const mrdamp_load* load, double* state,
                                  double* measurements);
/* One control period of n rows with constant commands (n x count): state n x size, loads n, criteria n x mrdamp_rows_criteria(),
 * measurements n x mrdamp_rows_measurements(). lanes: rows that a core steps at once, at most: 1, 2, 4, 8; 0: what its
 * vector units take. Results do not depend on the numbers of threads and lanes. One call at a time. */
MRDAMP_API void mrdamp_rows_step(mrdamp_rows* rows, int n, double* state, const mrdamp_load* loads, const double* commands,
                                 double* criteria, double* measurements, int threads, int lanes);
/* The same of n rows that are each the only one of a structure of its own, all with as many dampers, criteria and measurements;
 * no structure twice. */
MRDAMP_API void mrdamp_rows_step_each(mrdamp_rows* const* rows, int n, double* const* states, const mrdamp_load* const* loads,
                                      const double* commands, double* criteria, double* measurements, int threads);

/* ---- one damper, sample by sample: for real-time code -------------------------------- */
typedef struct mrdamp_damper mrdamp_damper;
MRDAMP_API mrdamp_damper* mrdamp_damper_new(int law, const double* params, const mrdamp_narx* net, char* err, int err_size);
MRDAMP_API void mrdamp_damper_free(mrdamp_damper* damper);
MRDAMP_API void mrdamp_damper_reset(mrdamp_damper* damper);
/* Force (N) at the end of a step of dt (s) that ends at displacement x and velocity v with the command
 * u constant over the step; the first call after a reset starts the damper at x. No allocation, no locks. */
MRDAMP_API double mrdamp_damper_step(mrdamp_damper* damper, double dt, double x, double v, double u);
/* value of a MRDAMP_... column after the last step */
MRDAMP_API double mrdamp_damper_value(const mrdamp_damper* damper, int column);

#ifdef __cplusplus
}
#endif

#endif /* MRDAMP_H_ */
