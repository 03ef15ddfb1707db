// What is said of the network between this computer and a camera.
#include "capture/device/aravis/gige_network.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace countershade::capture {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::uint32_t ip(int a, int b, int c, int d) {
  return static_cast<std::uint32_t>(a) << 24 | b << 16 | c << 8 | d;
}
const NetworkCard kOffice{"eth0", ip(192, 168, 1, 20), ip(255, 255, 255, 0), 1500},
    kCameras{"eth1", ip(169, 254, 3, 1), ip(255, 255, 0, 0), 9000},
    kWireless{"wlan0", ip(192, 168, 1, 77), ip(255, 255, 255, 0), 1500};

TEST(SubnetHindrance, NamesTheCardsThatAreTooManyOrThatThereIsNone) {
  EXPECT_EQ(subnet_hindrance("192.168.1.5", {kOffice, kCameras}), "");
  EXPECT_EQ(subnet_hindrance("169.254.200.5", {kOffice, kCameras}), "");
  EXPECT_THAT(subnet_hindrance("192.168.2.5", {kOffice, kCameras}), HasSubstr("in the subnet of 192.168.2.5"));
  EXPECT_THAT(subnet_hindrance("192.168.1.5", {kOffice, kCameras, kWireless}),
              AllOf(HasSubstr("eth0 and wlan0"), HasSubstr("different subnets")));
  NetworkCard second = kOffice;
  second.address += 1;
  EXPECT_EQ(subnet_hindrance("192.168.1.5", {kOffice, second}), "") << "one card with two addresses";
  EXPECT_EQ(subnet_hindrance("no address", {kOffice}), "");
}

TEST(PacketAdvice, NamesTheCardThatTakesSmallPackets) {
  EXPECT_THAT(packet_advice("192.168.1.5", {kOffice, kCameras}), AllOf(HasSubstr("1500 bytes"), HasSubstr("dev eth0")));
  EXPECT_EQ(packet_advice("169.254.200.5", {kOffice, kCameras}), "");
  EXPECT_EQ(packet_advice("10.0.0.1", {kOffice, kCameras}), "");
}

TEST(NetworkCards, AreThoseOfThisComputer) {
  const std::vector<NetworkCard> cards = network_cards();
  if (cards.empty()) GTEST_SKIP() << "no network here, not even with itself";
  for (const NetworkCard& card : cards) EXPECT_GT(card.mtu, 0) << card.name;
  EXPECT_THAT(cards, ::testing::Contains(::testing::AllOf(::testing::Field(&NetworkCard::address, ip(127, 0, 0, 1)),
                                                          ::testing::Field(&NetworkCard::mask, ip(255, 0, 0, 0)))));
}

TEST(IsControlled, NobodyControlsACameraThatIsNotThere) {
  EXPECT_FALSE(is_controlled("no address"));
}

}  // namespace
}  // namespace countershade::capture
