// SPDX-License-Identifier: Apache-2.0
#include "builder/surface/sheet_sides.h"

#include <algorithm>
#include <utility>

#include "builder/disk/packed_numbers.h"

namespace mtdb::internal {

SheetSides::SheetSides(const Options& options)
    : options_(options),
      places_(options.space, options.memory_bytes / 8),
      turned_(options.space, options.memory_bytes / 8) {
  static_assert(sizeof(Set) + sizeof(uint32_t) + 2 * sizeof(Fate) <= kTriangleBytes);
  const size_t blocks = options.triangles == 0 ? 0 : BlockOf(options.triangles - 1) + 1;
  for (size_t i = 0; i < blocks; ++i) {
    const size_t memory = options.memory_bytes / 4 / blocks;
    links_.push_back({Spool(options.space, memory)});
    messages_.emplace_back(options.space, memory);
    answers_.emplace_back(options.space, memory);
  }
}

uint32_t SheetSides::SizeOf(size_t block) const {
  return static_cast<uint32_t>(
      std::min<uint64_t>(options_.block, options_.triangles - FirstOf(block)));
}

void SheetSides::Set::Add(const Set& other, bool turned) {
  for (size_t side = 0; side < 2; ++side) triangles[side] += other.triangles[side ^ turned];
  one_sided |= other.one_sided;
  if (other.first < first) {
    first = other.first;
    first_turned = other.first_turned != turned;
  }
}

Status SheetSides::Link(const SheetLink& link) {
  LinkSpool& to = links_[BlockOf(link.a)];
  std::byte bytes[2 * kMaxVarintBytes];
  const auto step = static_cast<int64_t>(link.a) - static_cast<int64_t>(to.last);
  const std::byte* const end =
      PutVarint(PutVarint(bytes, ZigZag(step)), (link.b - link.a) << 1 | uint64_t{link.turned});
  to.last = link.a;
  return to.spool.Append(bytes, static_cast<size_t>(end - bytes));
}

template <typename F>
Status SheetSides::ForEachLink(size_t block, F&& f) {
  SpoolReader reader(&links_[block].spool);
  uint64_t last = 0;
  while (reader.remaining() != 0) {
    const std::byte* const bytes = reader.Peek(2 * kMaxVarintBytes);
    if (bytes == nullptr) return reader.status();
    uint64_t step = 0, rest = 0;
    const std::byte* const end = GetVarint(GetVarint(bytes, &step), &rest);
    reader.Skip(static_cast<size_t>(end - bytes));
    last = static_cast<uint64_t>(static_cast<int64_t>(last) + UnZigZag(step));
    MTDB_RETURN_IF_ERROR(f(SheetLink{last, last + (rest >> 1), (rest & 1) != 0}));
  }
  return Status::Ok();
}

// The first number of a set stands for it.
Status SheetSides::JoinInside(size_t block) {
  const uint64_t first = FirstOf(block);
  const uint32_t size = SizeOf(block);
  sets_ = ParitySets(size);
  all_.assign(size, {});
  const auto join = [&](const SheetLink& link) {
    if (link.b >= first + size) return Status::Ok();
    ParitySets::Place a = sets_.Find(static_cast<uint32_t>(link.a - first));
    ParitySets::Place b = sets_.Find(static_cast<uint32_t>(link.b - first));
    const bool turned = (a.turned != b.turned) != link.turned;
    if (a.first == b.first) {
      all_[a.first].one_sided |= turned;
      return Status::Ok();
    }
    if (b.first < a.first) std::swap(a, b);
    sets_.Join(a.first, b.first, turned);
    all_[a.first].one_sided |= all_[b.first].one_sided;
    return Status::Ok();
  };
  MTDB_RETURN_IF_ERROR(ForEachLink(block, join));
  for (uint32_t i = 0; i < size; ++i) {
    const ParitySets::Place place = sets_.Find(i);
    Set& set = all_[place.first];
    if (place.first == i) set.first = first + i;
    ++set.triangles[place.turned];
    const uint32_t noted = place.first << 1 | static_cast<uint32_t>(place.turned);
    MTDB_RETURN_IF_ERROR(places_.Append(&noted, sizeof(noted)));
  }
  return Status::Ok();
}

// From sets of earlier blocks.
Status SheetSides::AddMessages(size_t block) {
  MTDB_RETURN_IF_ERROR(messages_[block].Finish());
  SpoolReader reader(&messages_[block]);
  while (reader.remaining() != 0) {
    Message message;
    if (!reader.Get(&message)) return reader.status();
    const ParitySets::Place place =
        sets_.Find(static_cast<uint32_t>(message.set.successor - FirstOf(block)));
    all_[place.first].Add(message.set, place.turned != message.set.successor_turned);
  }
  return Status::Ok();
}

// The links to later blocks.
Status SheetSides::PassOn(size_t block) {
  const uint64_t end = FirstOf(block) + SizeOf(block);
  const auto pass = [&](const SheetLink& link) {
    if (link.b < end) return Status::Ok();
    const ParitySets::Place place = sets_.Find(static_cast<uint32_t>(link.a - FirstOf(block)));
    const bool turned = place.turned != link.turned;
    Set& set = all_[place.first];
    if (set.successor == 0) {
      set.successor = link.b;
      set.successor_turned = turned;
    } else if (set.successor == link.b) {
      set.one_sided |= set.successor_turned != turned;
    } else {
      const auto [a, b] = std::minmax(set.successor, link.b);
      return Link({a, b, set.successor_turned != turned});
    }
    return Status::Ok();
  };
  MTDB_RETURN_IF_ERROR(ForEachLink(block, pass));
  links_[block].spool = Spool(nullptr, 0);
  return Status::Ok();
}

SheetSides::Fate SheetSides::FateOf(const Set& set) {
  ++counts_.sheets;
  if (set.one_sided) {
    ++counts_.unorientable;
    return Fate::kOneSided;
  }
  const auto [as_first, against] = set.triangles;
  counts_.turned_triangles += std::min(as_first, against);
  const bool turns = as_first != against ? as_first < against : set.first_turned;
  return turns ? Fate::kTurns : Fate::kStays;
}

// Each set of the block goes to its successor, or is a sheet.
Status SheetSides::Finish(size_t block) {
  for (uint32_t i = 0; i < all_.size(); ++i) {
    const Set& set = all_[i];
    if (set.triangles[0] == 0) continue;  // belongs to another one
    if (set.successor != 0) {
      const Message message{FirstOf(block) + i, set};
      MTDB_RETURN_IF_ERROR(messages_[BlockOf(set.successor)].Append(&message, sizeof(message)));
    } else {
      const Answer answer{i, FateOf(set)};
      MTDB_RETURN_IF_ERROR(answers_[block].Append(&answer, sizeof(answer)));
    }
  }
  return Status::Ok();
}

Result<SheetCounts> SheetSides::Count() {
  for (size_t block = 0; block < links_.size(); ++block) {
    MTDB_RETURN_IF_ERROR(links_[block].spool.Finish());
    MTDB_RETURN_IF_ERROR(JoinInside(block));
    MTDB_RETURN_IF_ERROR(AddMessages(block));
    MTDB_RETURN_IF_ERROR(PassOn(block));
    MTDB_RETURN_IF_ERROR(Finish(block));
  }
  all_ = {};
  sets_ = ParitySets();
  MTDB_RETURN_IF_ERROR(places_.Finish());
  return counts_;
}

Status SheetSides::Resolve() {
  std::vector<Fate> fates;
  std::vector<uint32_t> places;
  for (size_t block = links_.size(); block-- > 0;) {
    const uint32_t size = SizeOf(block);
    fates.assign(size, Fate::kStays);
    places.resize(size);
    MTDB_RETURN_IF_ERROR(answers_[block].Finish());
    SpoolReader answers(&answers_[block]);
    while (answers.remaining() != 0) {
      Answer answer;
      if (!answers.Get(&answer)) return answers.status();
      fates[answer.place] = answer.fate;
    }
    answers_[block] = Spool(nullptr, 0);
    MTDB_RETURN_IF_ERROR(
        places_.Read(FirstOf(block) * sizeof(uint32_t), places.data(), size * sizeof(uint32_t)));
    const auto fate_of = [&](uint32_t place, bool turned) {
      const Fate fate = fates[places[place] >> 1];
      if (fate == Fate::kOneSided) return fate;
      const bool turns = (fate == Fate::kTurns) != ((places[place] & 1) != 0);
      return turns != turned ? Fate::kTurns : Fate::kStays;
    };
    SpoolReader messages(&messages_[block]);
    while (messages.remaining() != 0) {
      Message m;
      if (!messages.Get(&m)) return messages.status();
      const auto place = static_cast<uint32_t>(m.set.successor - FirstOf(block));
      const size_t asking = BlockOf(m.from);
      const Answer answer{static_cast<uint32_t>(m.from - FirstOf(asking)),
                          fate_of(place, m.set.successor_turned)};
      MTDB_RETURN_IF_ERROR(answers_[asking].Append(&answer, sizeof(answer)));
    }
    messages_[block] = Spool(nullptr, 0);
    for (uint32_t i = 0; i < size; ++i) {
      const auto turns = static_cast<uint8_t>(fate_of(i, false) == Fate::kTurns);
      MTDB_RETURN_IF_ERROR(turned_.Append(&turns, sizeof(turns)));
    }
  }
  return turned_.Finish();
}

Result<bool> SheetSides::NextIsTurned() {
  const uint32_t place = static_cast<uint32_t>(next_ % options_.block);
  if (place == 0) {
    const size_t block = BlockOf(next_);
    buffer_.resize(SizeOf(block));
    const uint64_t behind = FirstOf(block) + SizeOf(block);
    MTDB_RETURN_IF_ERROR(turned_.Read(options_.triangles - behind, buffer_.data(), buffer_.size()));
  }
  ++next_;
  return buffer_[place] != 0;
}

}  // namespace mtdb::internal
