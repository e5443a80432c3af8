#pragma once

#include <string>
#include <vector>

#include "evaluation/figures.hpp"
#include "evaluation/trials.hpp"

namespace lidar_camera_recalibration::evaluation {

/// What else belongs to the figures, for people and scripts.
struct Circumstances {
  std::string folder, layout;
  InputChoice choice;
};

/// On stdout: what is measured and the head of the table, a row, and what the columns mean.
void printHead(const Plan& plan, const Circumstances& circumstances);
void printRow(const Cell& cell);
void printLegend(const Plan& plan);

/// One line a trial.
std::string toCsv(const std::vector<Cell>& cells);

/// The figures of all cells.
std::string toJson(const Plan& plan, const Circumstances& circumstances, const std::vector<Cell>& cells);

}  // namespace lidar_camera_recalibration::evaluation
