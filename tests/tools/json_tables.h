// SPDX-License-Identifier: Apache-2.0
// The tables of docs/json.md, and answers compared with them.
#pragma once

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {

class JsonTables {
 public:
  JsonTables() {
    std::ifstream doc(std::string(MTDB_SOURCE_DIR) + "/docs/json.md");
    REQUIRE(doc.is_open());
    std::string table;
    for (std::string line; std::getline(doc, line);) {
      if (line.starts_with("## ")) table = line.substr(3);
      if (line.starts_with("All fields of `")) {
        fields_[table] = fields_.at(line.substr(15, line.find('`', 15) - 15));
        // Optional ones need not be in both answers.
        for (const auto& [name, field] : fields_[table]) {
          if (field.optional) seen_.emplace(table, name);
        }
      }
      if (table.empty() || !line.starts_with("| `")) continue;
      const size_t name_end = line.find('`', 3), type = name_end + 4, end = line.find(" |", type);
      REQUIRE(end != std::string::npos);
      Field field{line.substr(type, end - type), false};
      const size_t optional = field.type.find(", optional");
      field.optional = optional != std::string::npos;
      field.type = field.type.substr(0, optional);
      fields_[table][line.substr(3, name_end - 3)] = field;
    }
    REQUIRE(fields_.size() > 20);
  }

  // Of a verb's whole answer.
  void Check(const Json& answer) {
    INFO(TextOf(answer, 1));
    REQUIRE(answer.is_object());
    REQUIRE(answer.contains("schema"));
    const std::string table = answer.at("schema");
    REQUIRE(fields_.contains(table));
    Json rest = answer;
    rest.erase("schema");
    CheckTable(rest, table);
  }

  // "table.field" of all that no answer had so far.
  std::vector<std::string> NeverSeen() const {
    std::vector<std::string> never;
    for (const auto& [table, fields] : fields_) {
      for (const auto& [name, field] : fields) {
        if (!seen_.contains({table, name})) never.push_back(table + "." + name);
      }
    }
    return never;
  }

 private:
  struct Field {
    std::string type;
    bool optional = false;
  };

  void CheckTable(const Json& value, const std::string& table) {
    INFO("in " << table);
    REQUIRE(value.is_object());
    for (const auto& [name, field] : fields_.at(table)) {
      if (!value.contains(name)) {
        INFO("missing: " << name);
        CHECK(field.optional);
        continue;
      }
      seen_.emplace(table, name);
      CheckType(value.at(name), field.type, name);
    }
    for (const auto& [name, part] : value.items()) {
      INFO("not in docs/json.md: " << name);
      CHECK(fields_.at(table).contains(name));
    }
  }

  void CheckType(const Json& value, const std::string& type, const std::string& name) {
    INFO(name << " is to be " << type << ", found " << TextOf(value));
    constexpr std::string_view kList = "list of ", kOrNull = " or null";
    if (type.ends_with(kOrNull)) {
      if (!value.is_null()) CheckType(value, type.substr(0, type.size() - kOrNull.size()), name);
    } else if (type.starts_with(kList)) {
      REQUIRE(value.is_array());
      for (const Json& part : value) CheckType(part, type.substr(kList.size()), name);
    } else if (type == "string") {
      CHECK(value.is_string());
    } else if (type == "boolean") {
      CHECK(value.is_boolean());
    } else if (type == "integer") {
      CHECK(value.is_number_integer());
    } else if (type == "number") {
      CHECK(value.is_number());
    } else if (type == "point" || type == "pair") {
      CHECK((value.is_array() && value.size() == (type == "point" ? 3 : 2)));
      for (const Json& part : value) CHECK(part.is_number());
    } else if (type == "map") {
      REQUIRE(value.is_object());
      for (const Json& part : value) CHECK(part.is_number());
    } else {
      REQUIRE(fields_.contains(type));
      CheckTable(value, type);
    }
  }

  std::map<std::string, std::map<std::string, Field>> fields_;
  std::set<std::pair<std::string, std::string>> seen_;
};

}  // namespace mtdb::test
