#include "builder/internal/decimator.h"

namespace mtdb::internal {

template class Decimator<SurfaceDistance, FreeFilling>;

}  // namespace mtdb::internal
