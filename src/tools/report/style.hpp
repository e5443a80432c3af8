#pragma once

namespace lidar_camera_recalibration {

/// The page's style sheet: one column on phones, light, and with page breaks between figures on paper.
extern const char* const kReportStyle;

}  // namespace lidar_camera_recalibration
