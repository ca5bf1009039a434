#include "codecs/internal/cluster_model.h"

namespace mtdb {

TopologyModel::TopologyModel(int reference_length) : lowest_length_(reference_length - 3) {}
ErrorModel::ErrorModel() = default;
PositionModel::PositionModel() = default;
ArcModel::ArcModel() = default;

}  // namespace mtdb
