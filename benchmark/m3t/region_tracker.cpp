// SPDX-License-Identifier: Apache-2.0
// M3T's region tracker, with its default settings, on a folder of colour images color_image_0000.png and on.
// Arguments: the folder, number of images, the model (OBJ), a file for what M3T works out from it.
// Standard input: fx fy cx cy width height, distance of the views that the model is drawn from [m], 3 x 4 first pose.
// Standard error has M3T's own messages. Standard output, among them: lines "pose", the 3 x 4 pose, CPU seconds.
#include <ctime>
#include <iostream>
#include <m3t/link.h>
#include <m3t/loader_camera.h>
#include <m3t/optimizer.h>
#include <m3t/region_modality.h>
#include <m3t/tracker.h>

int main(int, char** arguments)
{
    const int images = std::stoi(arguments[2]);
    m3t::Intrinsics camera_numbers;
    float distance;
    std::cin >> camera_numbers.fu >> camera_numbers.fv >> camera_numbers.ppu >> camera_numbers.ppv;
    std::cin >> camera_numbers.width >> camera_numbers.height >> distance;
    m3t::Transform3fA pose = m3t::Transform3fA::Identity();
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++)
            std::cin >> pose.matrix()(i, j);

    auto camera = std::make_shared<m3t::LoaderColorCamera>("camera", arguments[1], camera_numbers, "color_image_", 0, 4);
    auto body = std::make_shared<m3t::Body>("body", arguments[3], 1.0F, true, true, m3t::Transform3fA::Identity());
    auto model = std::make_shared<m3t::RegionModel>("model", body, arguments[4], distance);
    auto region = std::make_shared<m3t::RegionModality>("region", body, camera, model);
    auto link = std::make_shared<m3t::Link>("link", body);
    link->AddModality(region);
    auto tracker = std::make_shared<m3t::Tracker>("tracker");
    tracker->AddOptimizer(std::make_shared<m3t::Optimizer>("optimizer", link));
    if (!tracker->SetUp())
        return 1;
    camera->set_load_index(0);
    if (!camera->SetUp())
        return 1;
    body->set_body2world_pose(pose);
    for (int k = 0; k < images; k++) {
        const std::clock_t begin = std::clock();
        if (k == 0)
            region->StartModality(0, 0);
        for (int pass = 0; pass < tracker->n_corr_iterations(); pass++) {
            tracker->CalculateCorrespondences(k, pass);
            for (int update = 0; update < tracker->n_update_iterations(); update++) {
                tracker->CalculateGradientAndHessian(k, pass, update);
                tracker->CalculateOptimization(k, pass, update);
            }
        }
        tracker->CalculateResults(k);
        const double seconds = double(std::clock() - begin) / CLOCKS_PER_SEC;
        pose = body->body2world_pose();
        std::cout << "\npose ";
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 4; j++)
                std::cout << pose.matrix()(i, j) << ' ';
        std::cout << seconds << std::endl;
        if (k + 1 < images && !tracker->UpdateCameras(k))
            return 1;
    }
}
