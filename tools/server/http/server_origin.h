// SPDX-License-Identifier: Apache-2.0
// Whom a server's client says it is: what keeps web pages of strangers out.
#pragma once

#include <boost/asio/ip/address.hpp>
#include <string>
#include <vector>

namespace mtdb::internal {

// Whether `host`, as a request has it, names this server: an address, localhost, or one of
// `allowed` ("*": any), with any port. Programs of the past send none. Under another name the page
// that asks may be anybody's, who makes the name mean this machine (DNS rebinding).
bool IsOwnHost(const std::string& host, const std::vector<std::string>& allowed);

// Whether who sends this Origin and Host may open a session: programs may, which send no origin,
// and pages of `allowed_origin` ("*": any) or of the server's own.
bool MayOpenSession(const std::string& origin, const std::string& host,
                    const std::string& allowed_origin);

// Clients that share what an address has: an IPv6 client has 64 bits of it for itself.
std::string ClientAddress(const boost::asio::ip::address& address);

}  // namespace mtdb::internal
