// A damper in an engine's steps: the chain of one law without most effects, compiled with
//   -DMRDAMP_PLAIN -DMRDAMP_PACK_LAW=kBoucWen -DMRDAMP_PACK=name -Dmrdamp=another_name
#include "core/steps.h"

#include "core/chain.cc"
#include "core/piece.cc"

extern "C" const MrdampSteps MRDAMP_PACK;
extern "C" const MrdampSteps MRDAMP_PACK = mrdamp::OwnSteps();
