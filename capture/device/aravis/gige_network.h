// What stands between this computer and a GigE camera.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace countershade::capture {

// A network card with an IPv4 address; one entry per address. Numbers as written: 192.168.1.2 is 0xc0a80102.
struct NetworkCard {
  std::string name;
  std::uint32_t address = 0, mask = 0;
  int mtu = 0;  // bytes of the largest packet
};
// Those that are up.
std::vector<NetworkCard> network_cards();

// Why photos of the camera at `address` (dotted) may not arrive, and the remedy: no card is in its subnet, or several
// are. Empty: nothing to be seen.
std::string subnet_hindrance(const std::string& address, const std::vector<NetworkCard>& cards);
// What would make its photos come faster, where the card that leads to it takes small packets only; else empty.
std::string packet_advice(const std::string& address, const std::vector<NetworkCard>& cards);
// Whether a program controls it now (bootstrap register CCP).
bool is_controlled(const std::string& address);

}  // namespace countershade::capture
