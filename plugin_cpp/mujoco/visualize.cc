// What the viewer shows of a damper: an arrow for the force that it puts on what it moves, its current as colour.
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "mujoco/damper.h"

namespace mrdamp {

namespace {

// Where the arrow starts and the direction of positive actuator force, in the world; false: nothing to draw at.
bool Place(const mjModel* m, const mjData* d, int actuator, mjtNum from[3], mjtNum direction[3]) {
  const int target = m->actuator_trnid[2 * actuator];
  switch (m->actuator_trntype[actuator]) {
    case mjTRN_JOINT:
    case mjTRN_JOINTINPARENT:
      mju_copy3(from, d->xanchor + 3 * target);
      mju_copy3(direction, d->xaxis + 3 * target);
      return true;
    case mjTRN_TENDON: {
      const int first = d->ten_wrapadr[target], last = first + d->ten_wrapnum[target] - 1;
      if (last <= first) return false;  // a fixed tendon has no path
      // A longer tendon is what positive force makes: its end is pushed away from its start.
      mju_copy3(from, d->wrap_xpos + 3 * last);
      mju_sub3(direction, d->wrap_xpos + 3 * last, d->wrap_xpos + 3 * first);
      break;
    }
    case mjTRN_SITE: {
      mju_copy3(from, d->site_xpos + 3 * target);
      mju_mulMatVec3(direction, d->site_xmat + 9 * target, m->actuator_gear + 6 * actuator);
      break;
    }
    default:
      return false;
  }
  return mju_normalize3(direction) > mjMINVAL;
}

// The field off to full on, in the colours of the pictures: blue to orange.
void Colour(const Damper& damper, double current, float rgba[4]) {
  const double most = damper.p.command_max, size = std::abs(current);
  const double share = std::isfinite(most) && most > 0 ? std::min(1.0, size / most) : size / (1 + size);
  constexpr float off[3] = {0.16f, 0.35f, 0.62f}, on[3] = {0.96f, 0.49f, 0.10f};
  for (int k = 0; k < 3; k++) rgba[k] = off[k] + static_cast<float>(share) * (on[k] - off[k]);
  rgba[3] = 1;
}

}  // namespace

void DamperInstance::Visualize(const mjModel* m, const mjData* d, mjvScene* scene) const {
  mjtNum from[3], to[3], direction[3];
  // As for contact forces: metres a newton are map.force over the mean mass; 0 draws nothing.
  const double scale = m->vis.map.force / std::max(m->stat.meanmass, mjMINVAL);
  if (scale <= 0 || scene->ngeom + 2 > scene->maxgeom || !Place(m, d, actuator_, from, direction)) return;
  float rgba[4];
  Colour(damper_, at_.seen.current, rgba);
  const double width = m->vis.scale.forcewidth * m->stat.meansize;
  const mjtNum ball[3] = {1.5 * width, 1.5 * width, 1.5 * width};
  mjvGeom* geom = scene->geoms + scene->ngeom++;
  mjv_initGeom(geom, mjGEOM_SPHERE, ball, from, nullptr, rgba);
  geom->category = mjCAT_DECOR;
  const double force = d->actuator_force[output_];
  if (!std::isfinite(force)) return;
  mju_addScl3(to, from, direction, scale * force);
  geom = scene->geoms + scene->ngeom++;
  mjv_initGeom(geom, mjGEOM_ARROW, nullptr, nullptr, nullptr, rgba);
  mjv_connector(geom, mjGEOM_ARROW, width, from, to);
  geom->category = mjCAT_DECOR;
}

}  // namespace mrdamp
