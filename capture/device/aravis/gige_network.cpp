#include "capture/device/aravis/gige_network.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <optional>

#include "capture/device/aravis/camera_memory.h"

namespace countershade::capture {

namespace {

constexpr int kSmallMtu = 3000;              // bytes: below, and the network takes no large packets
constexpr std::uint32_t kPrivilege = 0xa00;  // CCP: who controls the camera, 0 = nobody

std::optional<std::uint32_t> number_of(const std::string& address) {
  in_addr parsed{};
  if (inet_aton(address.c_str(), &parsed) == 0) return std::nullopt;
  return ntohl(parsed.s_addr);
}

std::vector<NetworkCard> cards_towards(const std::string& address, const std::vector<NetworkCard>& cards) {
  std::vector<NetworkCard> towards;
  const auto camera = number_of(address);
  for (const NetworkCard& card : cards)
    if (camera && (*camera & card.mask) == (card.address & card.mask) &&
        std::none_of(towards.begin(), towards.end(), [&](const NetworkCard& t) { return t.name == card.name; }))
      towards.push_back(card);
  return towards;
}

}  // namespace

std::vector<NetworkCard> network_cards() {
  std::vector<NetworkCard> cards;
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0) return cards;
  const int any = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  for (const ifaddrs* one = first; one; one = one->ifa_next) {
    if (!one->ifa_addr || !one->ifa_netmask || one->ifa_addr->sa_family != AF_INET || !(one->ifa_flags & IFF_UP))
      continue;
    const auto number = [](const sockaddr* a) {
      return ntohl(reinterpret_cast<const sockaddr_in*>(a)->sin_addr.s_addr);
    };
    NetworkCard card{one->ifa_name, number(one->ifa_addr), number(one->ifa_netmask), 0};
    ifreq request{};
    std::strncpy(request.ifr_name, one->ifa_name, IFNAMSIZ - 1);
    if (any >= 0 && ioctl(any, SIOCGIFMTU, &request) == 0) card.mtu = request.ifr_mtu;
    cards.push_back(std::move(card));
  }
  if (any >= 0) close(any);
  freeifaddrs(first);
  return cards;
}

std::string subnet_hindrance(const std::string& address, const std::vector<NetworkCard>& cards) {
  const std::vector<NetworkCard> towards = cards_towards(address, cards);
  if (towards.empty() && number_of(address))
    return fmt::format(
        "no network card of this computer is in the subnet of {}: give the card that the camera hangs on an address "
        "there (sudo ip addr add), or the camera one, by the maker's tool",
        address);
  if (towards.size() > 1)
    return fmt::format(
        "the network cards {} and {} are both in the subnet of {}, and its photos may go to the wrong one: give the "
        "cards different subnets",
        towards[0].name, towards[1].name, address);
  return "";
}

std::string packet_advice(const std::string& address, const std::vector<NetworkCard>& cards) {
  const std::vector<NetworkCard> towards = cards_towards(address, cards);
  if (towards.size() != 1 || towards[0].mtu == 0 || towards[0].mtu >= kSmallMtu) return "";
  return fmt::format(
      "packets have {0} bytes at most: sudo ip link set dev {1} mtu 9000, where card and switch can, costs less of "
      "this computer",
      towards[0].mtu, towards[0].name);
}

bool is_controlled(const std::string& address) {
  const std::vector<std::uint8_t> privilege = CameraMemory(address).read(kPrivilege, 4);
  return std::any_of(privilege.begin(), privilege.end(), [](std::uint8_t b) { return b != 0; });
}

}  // namespace countershade::capture
