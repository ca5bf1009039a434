// SPDX-License-Identifier: Apache-2.0
#include "tools/server/http/server_origin.h"

#include <algorithm>
#include <boost/beast/core/string.hpp>

#include "tools/client/http_client.h"
#include "tools/client/network.h"

namespace mtdb::internal {

namespace ip = boost::asio::ip;

bool IsOwnHost(const std::string& host, const std::vector<std::string>& allowed) {
  if (host.empty()) return true;
  const Result<HttpUrl> url = ParseHttpUrl("http://" + host);
  if (!url.ok()) return false;
  ErrorCode error;
  ip::make_address(url->host, error);
  if (!error || beast::iequals(url->host, "localhost")) return true;
  return std::ranges::any_of(allowed, [&](const std::string& name) {
    return name == "*" || beast::iequals(name, url->host);
  });
}

bool MayOpenSession(const std::string& origin, const std::string& host,
                    const std::string& allowed_origin) {
  return origin.empty() || allowed_origin == "*" || origin == allowed_origin ||
         origin == "http://" + host;
}

std::string ClientAddress(const ip::address& address) {
  if (!address.is_v6()) return address.to_string();
  ip::address_v6 v6 = address.to_v6();
  if (v6.is_v4_mapped()) return ip::make_address_v4(ip::v4_mapped, v6).to_string();
  ip::address_v6::bytes_type bytes = v6.to_bytes();
  std::fill(bytes.begin() + 8, bytes.end(), static_cast<unsigned char>(0));
  return ip::address_v6(bytes).to_string() + "/64";
}

}  // namespace mtdb::internal
