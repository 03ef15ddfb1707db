#include "tests/device/aravis/genicam.h"

#include <fmt/format.h>

#include <algorithm>

#include "capture/device/pixel_format.h"

namespace countershade::testing {

namespace {

std::string registers_xml(const GenicamTransport& transport) {
  std::string text;
  for (const auto& [name, address] : {std::pair("WidthReg", kWidth),
                                      {"HeightReg", kHeight},
                                      {"FormatReg", kFormat},
                                      {"ExposureReg", kExposure},
                                      {"AutoReg", kExposureAuto},
                                      {"RunReg", kRun},
                                      {"TriggerModeReg", kTriggerMode},
                                      {"TriggerSourceReg", kTriggerSource},
                                      {"TriggerReg", kTrigger},
                                      {"ZeroReg", kZero},
                                      {"ModeReg", kAcquisitionMode}})
    text += fmt::format(
        "<IntReg Name=\"{}\"><Address>{:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort>"
        "<Sign>Unsigned</Sign><Endianess>{}</Endianess></IntReg>\n",
        name, transport.base + static_cast<std::uint32_t>(address), transport.endianness);
  return text;
}

std::string enumeration(const std::string& name, const std::vector<std::pair<std::string, std::uint32_t>>& entries,
                        const std::string& in) {
  std::string text = fmt::format("<Enumeration Name=\"{}\">", name);
  for (const auto& [entry, value] : entries)
    text += fmt::format("<EnumEntry Name=\"{}\"><Value>{}</Value></EnumEntry>", entry, value);
  return text + fmt::format("<pValue>{}</pValue></Enumeration>\n", in);
}

std::string integer(const std::string& name, const std::string& in, long long least, long long most) {
  return fmt::format("<Integer Name=\"{}\"><pValue>{}</pValue><Min>{}</Min><Max>{}</Max></Integer>\n", name, in, least,
                     most);
}

// Of USB3 Vision's technology-agnostic bootstrap registers (GenCP).
std::string text_register(const std::string& name, std::uint32_t address) {
  return fmt::format(
      "<StringReg Name=\"{}\"><Address>{:#x}</Address><Length>64</Length><AccessMode>RO</AccessMode>"
      "<pPort>Device</pPort></StringReg>\n",
      name, address);
}

}  // namespace

std::string genicam_description(const GenicamCamera& camera, const GenicamTransport& transport) {
  std::vector<std::pair<std::string, std::uint32_t>> formats;
  for (const capture::PixelFormat& f : capture::pixel_formats())
    if (std::find(camera.formats.begin(), camera.formats.end(), f.name) != camera.formats.end())
      formats.emplace_back(f.name, f.code);
  std::string features;
  for (const std::string f : {"Width", "Height", "PixelFormat", "AcquisitionMode", "AcquisitionStart",
                              "AcquisitionStop", "ExposureTime", "ExposureAuto", "TriggerSelector", "TriggerMode",
                              "TriggerSource", "TriggerActivation", "TriggerSoftware", "PayloadSize"})
    if (camera.triggered || !f.starts_with("Trigger")) features += fmt::format("<pFeature>{}</pFeature>", f);
  const std::string trigger =
      enumeration("TriggerSelector", {{"FrameStart", 0}}, "ZeroReg") +
      enumeration("TriggerMode", {{"Off", 0}, {"On", 1}}, "TriggerModeReg") +
      enumeration("TriggerSource", {{"Line0", 0}, {"Software", 1}}, "TriggerSourceReg") +
      enumeration("TriggerActivation", {{"RisingEdge", 0}}, "ZeroReg") +
      "<Command Name=\"TriggerSoftware\"><pValue>TriggerReg</pValue><CommandValue>1</CommandValue></Command>\n";
  return "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
         "<RegisterDescription ModelName=\"RoomCamera\" VendorName=\"Countershade\" ToolTip=\"tests\" "
         "StandardNameSpace=\"" +
         transport.name +
         "\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" "
         "MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" "
         "ProductGuid=\"0e4a1c52-7f0d-4a0e-8c4e-2f3b7d9a6b10\" VersionGuid=\"0e4a1c52-7f0d-4a0e-8c4e-2f3b7d9a6b11\" "
         "xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">\n<Category Name=\"Root\">" +
         features + "</Category>\n" + integer("Width", "WidthReg", camera.width, camera.width) +
         integer("Height", "HeightReg", camera.height, camera.height) +
         enumeration("PixelFormat", formats, "FormatReg") +
         enumeration("AcquisitionMode", {{"Continuous", 0}}, "ModeReg") +
         "<Command Name=\"AcquisitionStart\"><pValue>RunReg</pValue><CommandValue>1</CommandValue></Command>\n"
         "<Command Name=\"AcquisitionStop\"><pValue>RunReg</pValue><CommandValue>0</CommandValue></Command>\n"
         "<Float "
         "Name=\"ExposureTime\"><pValue>ExposureReg</pValue><Min>10</Min><Max>1000000</Max><Unit>us</Unit></Float>\n" +
         enumeration("ExposureAuto", {{"Off", 0}, {"Continuous", 1}}, "AutoReg") + (camera.triggered ? trigger : "") +
         "<IntSwissKnife Name=\"PayloadSize\"><pVariable Name=\"W\">WidthReg</pVariable><pVariable "
         "Name=\"H\">HeightReg</pVariable><pVariable Name=\"F\">FormatReg</pVariable>"
         "<Formula>W*H*((F&gt;&gt;16)&amp;0xFF)/8</Formula></IntSwissKnife>\n" +
         (transport.name == "U3V" ? text_register("DeviceVendorName", 0x4) + text_register("DeviceModelName", 0x44)
                                  : "") +
         registers_xml(transport) + "<Port Name=\"Device\"/>\n</RegisterDescription>\n";
}

}  // namespace countershade::testing
