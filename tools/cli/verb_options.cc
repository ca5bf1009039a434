// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/verb_options.h"

#include <CLI/CLI.hpp>
#include <optional>
#include <utility>

namespace mtdb {

VerbOption VerbOption::Required() const {
  option_->required();
  return *this;
}

VerbOption VerbOption::Form(const std::string& form) const {
  option_->type_name(form);
  return *this;
}

VerbOption VerbOption::Default(const std::string& text) const {
  option_->default_str(text);
  return *this;
}

VerbOption VerbOption::Group(const std::string& heading) const {
  option_->group(heading);
  return *this;
}

VerbOption VerbOption::Values(int least, int most) const {
  option_->expected(least, most);
  return *this;
}

VerbOption VerbOption::Repeatable() const {
  option_->expected(1)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  return *this;
}

VerbOption VerbOption::Excludes(VerbOption other) const {
  option_->excludes(other.option_);
  return *this;
}

VerbOption VerbOption::Excludes(const std::string& name) const {
  option_->excludes(name);
  return *this;
}

VerbOption VerbOption::Needs(VerbOption other) const {
  option_->needs(other.option_);
  return *this;
}

VerbOption VerbOption::Between(int64_t least, int64_t most) const {
  option_->check(CLI::Range(least, most));
  return *this;
}

VerbOption VerbOption::OneOf(const std::vector<std::string>& values) const {
  option_->check(CLI::IsMember(values));
  return *this;
}

VerbOption VerbOption::Check(std::function<std::string(const std::string&)> check) const {
  option_->check(std::move(check));
  return *this;
}

bool VerbOption::is_given() const { return option_->count() > 0; }

template <typename Value>
VerbOption VerbOptions::Add(const std::string& name, Value& value, const std::string& description) {
  return VerbOption(verb_->add_option(name, value, description));
}
template VerbOption VerbOptions::Add(const std::string&, std::string&, const std::string&);
template VerbOption VerbOptions::Add(const std::string&, std::vector<std::string>&,
                                     const std::string&);
template VerbOption VerbOptions::Add(const std::string&, std::optional<std::string>&,
                                     const std::string&);
template VerbOption VerbOptions::Add(const std::string&, uint16_t&, const std::string&);
template VerbOption VerbOptions::Add(const std::string&, uint32_t&, const std::string&);
template VerbOption VerbOptions::Add(const std::string&, std::optional<int>&, const std::string&);
template VerbOption VerbOptions::Add(const std::string&, std::optional<uint32_t>&,
                                     const std::string&);

VerbOption VerbOptions::AddFlag(const std::string& name, bool& value,
                                const std::string& description) {
  return VerbOption(verb_->add_flag(name, value, description));
}

VerbOption VerbOptions::AddFlag(const std::string& name, std::function<void()> given,
                                const std::string& description) {
  return VerbOption(verb_->add_flag_callback(name, std::move(given), description));
}

namespace {

void Take(const std::string& name, const std::function<Status(const std::string&)>& take,
          const std::string& text) {
  const Status status = take(text);
  if (!status.ok()) throw CLI::ValidationError(name, status.message());
}

}  // namespace

VerbOption VerbOptions::AddText(const std::string& name,
                                std::function<Status(const std::string&)> take,
                                const std::string& description) {
  return VerbOption(verb_->add_option_function<std::string>(
      name, [name, take](const std::string& text) { Take(name, take, text); }, description));
}

VerbOption VerbOptions::AddTexts(const std::string& name,
                                 std::function<Status(const std::string&)> take,
                                 const std::string& description) {
  const auto take_all = [name, take](const std::vector<std::string>& texts) {
    for (const std::string& text : texts) Take(name, take, text);
  };
  return VerbOption(
             verb_->add_option_function<std::vector<std::string>>(name, take_all, description))
      .Repeatable();
}

void VerbOptions::CheckAll(std::function<Status()> check) {
  verb_->callback([check = std::move(check)] {
    const Status status = check();
    if (!status.ok()) throw CLI::ValidationError(status.message());
  });
}

}  // namespace mtdb
