/* A model with MR dampers stepped by a C program: the plugin is loaded by its path, as `mrdamp plugin-path` prints it.
 *
 *     M=$(python -c 'import mujoco; print(*mujoco.__path__)')
 *     gcc -std=c99 -I$M/include examples/step.c $M/libmujoco.so.4.0.0 -Wl,-rpath,$M -o step
 *     ./step "$(mrdamp plugin-path)" models_xml/quarter_car/model.xml 1.0
 *
 * Prints time (s), damper force (N) and stroke (m) every 10 ms; the last argument is the command of every damper.
 */
#include <mujoco/mujoco.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int main(int argc, char** argv) {
  char error[500] = "";
  if (argc != 4) {
    fprintf(stderr, "usage: step PLUGIN MODEL COMMAND\n");
    return 2;
  }
  mj_loadPluginLibrary(argv[1]);
  mjModel* m = mj_loadXML(argv[2], NULL, error, sizeof error);
  if (!m) {
    fprintf(stderr, "step: %s\n", error);
    return 1;
  }
  mjData* d = mj_makeData(m);
  int damper = -1;
  for (int a = m->nactuator - 1; a >= 0; a--) {
    int slot = m->actuator_plugin[a] < 0 ? -1 : m->plugin[m->actuator_plugin[a]];
    if (slot < 0 || strcmp(mjp_getPluginAtSlot(slot)->name, "mrdamp.damper") != 0) continue;
    damper = a;
    d->ctrl[m->actuator_ctrladr[a]] = atof(argv[3]);
  }
  if (damper < 0) {
    fprintf(stderr, "step: %s has no mrdamp.damper\n", argv[2]);
    return 1;
  }
  d->qvel[m->nv - 1] = 0.5; /* m/s, the last joint is set in motion */
  for (int step = 0; d->time < 0.5; step++) {
    mj_step(m, d);
    if (step % (int)(0.01 / m->opt.timestep + 0.5) == 0) {
      int output = m->actuator_outadr[damper];
      printf("%.4f %.3f %.6f\n", d->time, -d->actuator_force[output], d->actuator_length[output]);
    }
  }
  mj_deleteData(d);
  mj_deleteModel(m);
  return 0;
}
