// SPDX-License-Identifier: Apache-2.0
// ViSP's model-based tracker on a list of images: a program of its own, built on the machine that measures.
// Standard input: mode (edge, scanline, klt), fx fy cx cy, angle_appear angle_disappear [degrees], number of models,
// for each its file and a 3 x 4 pose, the 3 x 4 pose of the first image, number of images, their files.
// Standard output, a line for each image: 1 if the tracker claims a pose, the 3 x 4 pose, CPU seconds.
#include <ctime>
#include <iostream>
#include <string>
#include <visp3/core/vpIoTools.h>
#include <visp3/io/vpImageIo.h>
#include <visp3/mbt/vpMbGenericTracker.h>

static vpHomogeneousMatrix read_pose()
{
    vpHomogeneousMatrix pose;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++)
            std::cin >> pose[i][j];
    return pose;
}

// GPL-2 libraries are linked here, so the program is never shipped.
int main()
{
    std::string mode, file;
    double fx, fy, cx, cy, appear, disappear;
    int models, images;
    std::cin >> mode >> fx >> fy >> cx >> cy >> appear >> disappear >> models;
    const bool points = mode == "klt";
    vpMbGenericTracker tracker(1, vpMbGenericTracker::EDGE_TRACKER | (points ? vpMbGenericTracker::KLT_TRACKER : 0));
    vpMe edges;
    edges.setMaskSize(5);
    edges.setMaskNumber(180);
    edges.setRange(8);
    edges.setThreshold(10000);
    edges.setMu1(0.5);
    edges.setMu2(0.5);
    edges.setSampleStep(4);
    tracker.setMovingEdge(edges);
    if (points) {
        vpKltOpencv klt;
        klt.setMaxFeatures(300);
        klt.setWindowSize(5);
        klt.setQuality(0.01);
        klt.setMinDistance(5);
        klt.setHarrisFreeParameter(0.01);
        klt.setBlockSize(3);
        klt.setPyramidLevels(3);
        tracker.setKltOpencv(klt);
        tracker.setKltMaskBorder(5);
    }
    tracker.setCameraParameters(vpCameraParameters(fx, fy, cx, cy));
    tracker.setAngleAppear(vpMath::rad(appear));
    tracker.setAngleDisappear(vpMath::rad(disappear));
    tracker.setNearClippingDistance(0.01);
    tracker.setFarClippingDistance(2.0);
    tracker.setClipping(tracker.getClipping() | vpMbtPolygon::FOV_CLIPPING);
    std::streambuf *answers = std::cout.rdbuf(std::cerr.rdbuf());  // loading a model talks
    for (int i = 0; i < models; i++) {
        std::cin >> file;
        tracker.loadModel(file, false, read_pose());
    }
    tracker.setScanLineVisibilityTest(mode != "edge");
    std::cout.rdbuf(answers);
    vpHomogeneousMatrix pose = read_pose();
    std::cin >> images;
    vpImage<unsigned char> image;
    for (int i = 0; i < images; i++) {
        std::cin >> file;
        vpImageIo::read(image, file);
        bool claimed = true;
        double seconds = 0.0;
        try {
            if (i == 0)
                tracker.initFromPose(image, pose);
            const std::clock_t start = std::clock();
            tracker.track(image);
            seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
            tracker.getPose(pose);
        } catch (const std::exception &) {
            claimed = false;
        }
        std::cout.precision(10);
        std::cout << claimed;
        for (int j = 0; j < 12; j++)
            std::cout << ' ' << pose[j / 4][j % 4];
        std::cout << ' ' << seconds << '\n';
    }
    return 0;
}
