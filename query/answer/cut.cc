// SPDX-License-Identifier: Apache-2.0
#include "query/cut.h"

#include <utility>

#include "query/answer/cut_impl.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

Cut::Cut(std::unique_ptr<CutImpl> impl) : impl_(std::move(impl)) {}
Cut::Cut(Cut&&) noexcept = default;
Cut& Cut::operator=(Cut&&) noexcept = default;
Cut::~Cut() = default;

bool Cut::applied(UnitId cluster, NodeIndex node) const { return impl_->applied(cluster, node); }
const ExtractStats& Cut::stats() const { return impl_->stats(); }
Status Cut::Emit(MeshSink& sink) {
  return CatchOutOfMemory([&] { return impl_->Emit(sink); });
}

}  // namespace mtdb
