// SPDX-License-Identifier: Apache-2.0
// One control step of ViSP on straight lines: features to twist, singular values included.
//
// Standard input: cycles, n, the camera's start and target position in the world (axes parallel to the world's), then
// for each line a point and a unit direction. Standard output: the median time of one cycle [us] and the twist.
//
// Compiled and run by benchmark/visp.py where ViSP is installed.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iostream>
#include <vector>

#include <visp3/core/vpHomogeneousMatrix.h>
#include <visp3/core/vpLine.h>
#include <visp3/visual_features/vpFeatureBuilder.h>
#include <visp3/visual_features/vpFeatureLine.h>
#include <visp3/vs/vpServo.h>

static vpLine read_line()
{
  double p[3], u[3];
  std::cin >> p[0] >> p[1] >> p[2] >> u[0] >> u[1] >> u[2];
  // Two planes through the line, with normals orthogonal to its direction and to each other.
  const int smallest = std::fabs(u[0]) < std::fabs(u[1]) ? (std::fabs(u[0]) < std::fabs(u[2]) ? 0 : 2)
                                                         : (std::fabs(u[1]) < std::fabs(u[2]) ? 1 : 2);
  double axis[3] = {0, 0, 0};
  axis[smallest] = 1;
  double a[3] = {u[1] * axis[2] - u[2] * axis[1], u[2] * axis[0] - u[0] * axis[2], u[0] * axis[1] - u[1] * axis[0]};
  const double length = std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
  for (double &each : a)
    each /= length;
  const double b[3] = {u[1] * a[2] - u[2] * a[1], u[2] * a[0] - u[0] * a[2], u[0] * a[1] - u[1] * a[0]};
  vpLine line;
  line.setWorldCoordinates(a[0], a[1], a[2], -(a[0] * p[0] + a[1] * p[1] + a[2] * p[2]),
                           b[0], b[1], b[2], -(b[0] * p[0] + b[1] * p[1] + b[2] * p[2]));
  return line;
}

int main()
{
  unsigned int cycles, n;
  double start[3], target[3];
  std::cin >> cycles >> n >> start[0] >> start[1] >> start[2] >> target[0] >> target[1] >> target[2];
  const vpHomogeneousMatrix cMo(-start[0], -start[1], -start[2], 0, 0, 0);
  const vpHomogeneousMatrix cdMo(-target[0], -target[1], -target[2], 0, 0, 0);
  std::vector<vpLine> lines;
  std::vector<vpFeatureLine> features(n), desired(n);
  vpServo task;
  task.setServo(vpServo::EYEINHAND_CAMERA);
  task.setInteractionMatrixType(vpServo::CURRENT);
  task.setLambda(0.1);
  for (unsigned int i = 0; i < n; i++) {
    lines.push_back(read_line());
    lines[i].track(cdMo);
    vpFeatureBuilder::create(desired[i], lines[i]);
    lines[i].track(cMo);
    vpFeatureBuilder::create(features[i], lines[i]);
    task.addFeature(features[i], desired[i]);
  }
  if (!std::cin) {
    std::cerr << "input too short" << std::endl;
    return 1;
  }
  std::vector<double> microseconds;
  vpColVector twist;
  double inverse_condition_number = 0;
  for (unsigned int cycle = 0; cycle < cycles; cycle++) {
    const auto before = std::chrono::steady_clock::now();
    for (unsigned int i = 0; i < n; i++)
      vpFeatureBuilder::create(features[i], lines[i]);
    twist = task.computeControlLaw();
    const vpColVector values = task.getTaskSingularValues();
    inverse_condition_number = values[values.size() - 1] / values[0];
    const std::chrono::duration<double, std::micro> time = std::chrono::steady_clock::now() - before;
    microseconds.push_back(time.count());
  }
  std::nth_element(microseconds.begin(), microseconds.begin() + cycles / 2, microseconds.end());
  std::cout.precision(17);
  std::cout << microseconds[cycles / 2] << " " << inverse_condition_number;
  for (unsigned int i = 0; i < 6; i++)
    std::cout << " " << twist[i];
  std::cout << std::endl;
}
