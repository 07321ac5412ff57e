/* One MR damper in a 1 kHz loop, without MuJoCo: C99 and mrdamp.h alone.
 *
 *   realtime [-i] [-p] [-n steps] [LAW name=value ...]
 *
 * Prints "t x v u F" (s, m, m/s, command, N), one line a step. Motion and command come from a
 * built-in sine (15 mm, 2.5 Hz, 1.5 V), or with -i from standard input, one "x v u" a line.
 * -p paces the loop to the clock, 1 ms a step; -n ends it after so many steps (1000 for the sine).
 * Without a law it runs the modified Bouc-Wen law with the numbers of Spencer, Dyke, Sain and
 * Carlson (1997), doi:10.1061/(ASCE)0733-9399(1997)123:3(230), Table 2, free of its preload (x0 = 0).
 */
#define _POSIX_C_SOURCE 200112L
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "mrdamp.h"

#define STEP 1e-3 /* s */

static const char* const kSpencer1997[] = {
    "c0a=2100",      "c0b=350",       "c1a=28300",  "c1b=295",     "k0=4690", "k1=500", "x0=0",
    "alpha_a=14000", "alpha_b=69500", "gamma=3.63e6", "beta=3.63e6", "A=301",   "n=2",    NULL};

/* Sets name=value in the vector; 0 on success. */
static int assign(double* params, const char* text) {
  const char* equals = strchr(text, '=');
  char* end = NULL;
  double value;
  int i, count = mrdamp_attribute_count();
  if (equals == NULL || equals == text) {
    fprintf(stderr, "realtime: \"%s\" is not of the form name=value\n", text);
    return 1;
  }
  value = strtod(equals + 1, &end);
  if (end == equals + 1 || *end != '\0' || !isfinite(value)) {
    fprintf(stderr, "realtime: \"%s\": \"%s\" is not a finite number\n", text, equals + 1);
    return 1;
  }
  for (i = 0; i < count; ++i) {
    const char* name = mrdamp_attribute_name(i);
    if (strlen(name) == (size_t)(equals - text) && strncmp(name, text, strlen(name)) == 0) {
      params[i] = value;
      return 0;
    }
  }
  fprintf(stderr, "realtime: no attribute \"%.*s\"; plugin_cpp/README.md lists them\n", (int)(equals - text),
          text);
  return 1;
}

static mrdamp_damper* make_damper(const char* law_name, const char* const* settings) {
  char err[256] = "";
  mrdamp_damper* damper;
  double* params;
  int law = mrdamp_law_find(law_name);
  if (law < 0 || strcmp(law_name, "narx") == 0) { /* narx needs a weights file: mrdamp_narx_parse */
    fprintf(stderr, "realtime: law \"%s\"; allowed: all but narx of", law_name);
    for (law = 0; law < mrdamp_law_count(); ++law) fprintf(stderr, " %s", mrdamp_law_name(law));
    fprintf(stderr, "\n");
    return NULL;
  }
  params = malloc(sizeof(double) * (size_t)mrdamp_attribute_count());
  if (params == NULL) return NULL;
  mrdamp_defaults(params);
  for (; *settings != NULL; ++settings) {
    if (assign(params, *settings) != 0) {
      free(params);
      return NULL;
    }
  }
  damper = mrdamp_damper_new(law, params, NULL, err, (int)sizeof err);
  free(params);
  if (damper == NULL) fprintf(stderr, "realtime: %s\n", err);
  return damper;
}

/* The next sample; 0 at the end of the input or, with a line on stderr, at a bad line. */
static int next_sample(int from_stdin, long step, double* x, double* v, double* u, int* failed) {
  const double amplitude = 0.015, omega = 2.0 * 3.14159265358979323846 * 2.5; /* m, rad/s */
  char line[256], rest;
  if (!from_stdin) {
    *x = amplitude * sin(omega * (double)step * STEP);
    *v = amplitude * omega * cos(omega * (double)step * STEP);
    *u = 1.5;
    return 1;
  }
  if (fgets(line, sizeof line, stdin) == NULL) return 0;
  if (sscanf(line, "%lf %lf %lf %c", x, v, u, &rest) == 3 && isfinite(*x) && isfinite(*v) && isfinite(*u)) {
    return 1;
  }
  fprintf(stderr, "realtime: line %ld is not three finite numbers \"x v u\"\n", step + 1);
  *failed = 1;
  return 0;
}

int main(int argc, char** argv) {
  int from_stdin = 0, paced = 0, failed = 0, a = 1;
  long step, steps = -1;
  double x, v, u;
  struct timespec due;
  mrdamp_damper* damper;
  for (; a < argc && argv[a][0] == '-'; ++a) {
    if (strcmp(argv[a], "-i") == 0) {
      from_stdin = 1;
    } else if (strcmp(argv[a], "-p") == 0) {
      paced = 1;
    } else if (strcmp(argv[a], "-n") == 0 && a + 1 < argc && (steps = atol(argv[a + 1])) > 0) {
      ++a;
    } else {
      fprintf(stderr, "usage: realtime [-i] [-p] [-n steps] [LAW name=value ...]\n");
      return 2;
    }
  }
  if (steps < 0 && !from_stdin) steps = 1000;
  damper = a < argc ? make_damper(argv[a], (const char* const*)argv + a + 1)
                    : make_damper("modified_bouc_wen", kSpencer1997);
  if (damper == NULL) return 2;

  clock_gettime(CLOCK_MONOTONIC, &due);
  for (step = 0; (steps < 0 || step < steps) && next_sample(from_stdin, step, &x, &v, &u, &failed); ++step) {
    double force = mrdamp_damper_step(damper, STEP, x, v, u);
    printf("%.7f %.9g %.9g %.9g %.12g\n", (double)step * STEP, x, v, u, force);
    if (paced) {
      due.tv_nsec += (long)(STEP * 1e9);
      if (due.tv_nsec >= 1000000000L) due.tv_nsec -= 1000000000L, ++due.tv_sec;
      fflush(stdout);
      while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR) continue;
    }
  }
  mrdamp_damper_free(damper);
  return failed ? 2 : 0;
}
