#include "builder/internal/decimator.h"

namespace mtdb {

template class Decimator<SurfaceDistance, FreeFilling>;

}  // namespace mtdb
