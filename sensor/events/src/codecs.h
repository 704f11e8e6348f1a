#pragma once
// One function per format; registry.cpp lists them.
#include "pecs/events/format.h"

namespace pecs::events {

Codec make_aedat4();
Codec make_evt3();
Codec make_dat();
Codec make_metavision_hdf5();
Codec make_dsec_hdf5();
Codec make_evt2();
Codec make_evt21();
Codec make_npz();
Codec make_csv();
Codec make_e2vid();
Codec make_v2e();

}  // namespace pecs::events
