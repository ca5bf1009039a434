// SPDX-License-Identifier: Apache-2.0
#include "codecs/coding/cluster_model.h"

namespace mtdb {

namespace {

#include "codecs/coding/cluster_priors.inc"

template <size_t kCount>
void Start(std::array<AdaptiveBit, kCount>& models, const uint16_t (&priors)[kCount]) {
  for (size_t i = 0; i < kCount; ++i) models[i].probability = priors[i];
}

template <size_t kCount>
void Start(std::array<AdaptiveSymbol, kCount>& models, const int16_t (&priors)[kCount][16]) {
  for (size_t i = 0; i < kCount; ++i) std::copy_n(priors[i], 16, models[i].below.begin());
}

}  // namespace

TopologyModel::TopologyModel() {
  Start(anchor_, kAnchorPriors);
  Start(take_, kTakePriors);
  Start(boundary_, kBoundaryPriors);
}

LatticeModel::LatticeModel() {
  Start(anchor_, kLatticeAnchorPriors);
  Start(take_, kLatticeTakePriors);
}

ErrorModel::ErrorModel() {
  Start(high_, kErrorPriors);
  Start(lattice_high_, kLatticeErrorPriors);
  Start(lattice_low_, kLatticeErrorLowPriors);
}

PositionModel::PositionModel() {
  Start(scaled_, kScaledPriors);
  Start(within_, kWithinPriors);
  Start(beyond_, kBeyondPriors);
  Start(heights_, kLatticeHeightPriors);
  Start(heights_beyond_, kLatticeBeyondPriors);
}

ArcModel::ArcModel() {
  Start(first_, kFirstArcPriors);
  Start(second_, kSecondArcPriors);
}

}  // namespace mtdb
