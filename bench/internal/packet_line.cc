// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/packet_line.h"

#include <algorithm>
#include <arpa/inet.h>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <deque>
#include <fcntl.h>
#include <fstream>
#include <linux/if.h>
#include <linux/if_tun.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <string_view>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

namespace mtdb {
namespace {

using Clock = std::chrono::steady_clock;
constexpr const char* kNearAddress = "10.77.0.1";
constexpr size_t kMostPacket = 2048;

Status Refused(const char* what) {
  return Unsupported(std::string(what) + ": " + std::strerror(errno));
}

void WriteFile(const char* path, std::string_view text) { std::ofstream(path) << text; }

ifreq Request(const char* device) {
  ifreq request{};
  std::strncpy(request.ifr_name, device, IFNAMSIZ - 1);
  return request;
}

bool SetUp(int socket, const char* device) {
  ifreq request = Request(device);
  request.ifr_flags = IFF_UP | IFF_RUNNING;
  return ::ioctl(socket, SIOCSIFFLAGS, &request) == 0;
}

bool SetAddress(int socket, const char* device, unsigned long which, const char* address) {
  ifreq request = Request(device);
  sockaddr_in in{};
  in.sin_family = AF_INET;
  ::inet_pton(AF_INET, address, &in.sin_addr);
  std::memcpy(&request.ifr_addr, &in, sizeof(in));
  return ::ioctl(socket, which, &request) == 0;
}

// Of the namespace that the thread is in: its loopback, and a device whose other end is this
// program.
Result<int> MakeHost(const char* address, const char* other) {
  constexpr const char* kDevice = "line0";
  WriteFile("/proc/sys/net/ipv4/tcp_congestion_control", "cubic");
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const int device = ::open("/dev/net/tun", O_RDWR | O_CLOEXEC | O_NONBLOCK);
  ifreq request = Request(kDevice);
  request.ifr_flags = IFF_TUN | IFF_NO_PI;
  const bool made = SetUp(socket, "lo") && device >= 0 &&
                    ::ioctl(device, TUNSETIFF, &request) == 0 &&
                    SetAddress(socket, kDevice, SIOCSIFADDR, address) &&
                    SetAddress(socket, kDevice, SIOCSIFDSTADDR, other) && SetUp(socket, kDevice);
  const Status status = made ? Status::Ok() : Refused("no TUN device");
  ::close(socket);
  if (status.ok()) return device;
  if (device >= 0) ::close(device);
  return status;
}

// Rights over namespaces, for who is not root.
Status EnterNamespace() {
  if (::unshare(CLONE_NEWNET) == 0) return Status::Ok();
  const uid_t user = ::getuid();
  const gid_t group = ::getgid();
  if (::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) return Refused("no network namespace");
  WriteFile("/proc/self/setgroups", "deny");
  WriteFile("/proc/self/uid_map", "0 " + std::to_string(user) + " 1");
  WriteFile("/proc/self/gid_map", "0 " + std::to_string(group) + " 1");
  return Status::Ok();
}

}  // namespace

Result<std::unique_ptr<PacketLine>> PacketLine::Make(const LineOptions& options) {
  MTDB_RETURN_IF_ERROR(EnterNamespace());
  std::unique_ptr<PacketLine> line(new PacketLine());
  const int near = ::open("/proc/thread-self/ns/net", O_RDONLY | O_CLOEXEC);
  MTDB_ASSIGN_OR_RETURN(line->near_device_, MakeHost(kNearAddress, far_address()));
  if (::unshare(CLONE_NEWNET) != 0) return Refused("no second network namespace");
  const Result<int> far = MakeHost(far_address(), kNearAddress);
  line->far_namespace_ = ::open("/proc/thread-self/ns/net", O_RDONLY | O_CLOEXEC);
  const bool back = ::setns(near, CLONE_NEWNET) == 0;
  ::close(near);
  if (!back) return Refused("no way back into the first network namespace");
  MTDB_ASSIGN_OR_RETURN(line->far_device_, far);
  PacketLine* const carrier = line.get();
  line->there_ =
      std::thread([=] { carrier->Carry(carrier->near_device_, carrier->far_device_, options); });
  line->back_ =
      std::thread([=] { carrier->Carry(carrier->far_device_, carrier->near_device_, options); });
  return line;
}

PacketLine::~PacketLine() {
  stopping_ = true;
  if (there_.joinable()) there_.join();
  if (back_.joinable()) back_.join();
  for (const int fd : {near_device_, far_device_, far_namespace_}) {
    if (fd >= 0) ::close(fd);
  }
}

void PacketLine::Carry(int from, int to, const LineOptions& options) {
  struct Packet {
    Clock::time_point due;
    std::string bytes;
  };
  const auto duration = [](double seconds) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  };
  std::deque<Packet> packets;
  Clock::time_point free_at;  // when the line has sent what was given to it
  char block[kMostPacket];
  while (!stopping_) {
    const auto now = Clock::now();
    for (; !packets.empty() && packets.front().due <= now; packets.pop_front()) {
      const std::string& bytes = packets.front().bytes;
      if (::write(to, bytes.data(), bytes.size()) < 0) continue;  // lost, as on any line
    }
    const auto wait = packets.empty() ? Clock::duration(std::chrono::milliseconds(20))
                                      : std::max(packets.front().due - now, Clock::duration(0));
    const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(wait).count();
    const timespec timeout{0, static_cast<long>(std::min<int64_t>(ns, 999'999'999))};
    pollfd asked{from, POLLIN, 0};
    if (::ppoll(&asked, 1, &timeout, nullptr) <= 0) continue;
    for (ssize_t n = 0; (n = ::read(from, block, sizeof(block))) > 0;) {
      const auto came = Clock::now();
      const double bytes = static_cast<double>(n);
      const auto free = std::max(free_at, came) + duration(bytes / options.bytes_per_second);
      if (packets.size() >= kQueuePackets) continue;
      free_at = free;
      packets.push_back({free_at + duration(options.round_trip_seconds / 2),
                         std::string(block, static_cast<size_t>(n))});
    }
  }
}

}  // namespace mtdb
