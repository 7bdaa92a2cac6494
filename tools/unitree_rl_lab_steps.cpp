// Runs unitree_rl_lab's own deployment program on states from a file, in place of a robot: its reader of deploy.yaml, its
// observation and action managers and its ONNX runner, as its state machine calls them. tools/check_unitree_rl_lab.py builds and runs it.
//
// Usage: unitree_rl_lab_steps FOLDER STATES > ROWS
// FOLDER holds exported/policy.onnx and params/deploy.yaml. A line of STATES has the quaternion (w, x, y, z), the angular velocity,
// the sticks (ly, lx, rx), and position and velocity of each motor in the SDK's order. A line of ROWS has the observation, the
// action and the targets in the policy's order, with the number of each before it.
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <unordered_map>
#include <vector>

#include "unitree_articulation.h"
#if __has_include("isaaclab/envs/mdp/observations/observations.h")
#include "isaaclab/envs/mdp/observations/observations.h"
using Observed = std::unordered_map<std::string, std::vector<float>>;
static const std::vector<float>& first(const Observed& observed) { return observed.at("obs"); }
#else
#include "isaaclab/envs/mdp/observations.h"
using Observed = std::vector<float>;
static const std::vector<float>& first(const Observed& observed) { return observed; }
#endif
#include "isaaclab/envs/mdp/actions/joint_actions.h"

// What the program reads of the SDK's messages.
struct Imu {
    std::array<float, 4> quaternion_{1.0f, 0.0f, 0.0f, 0.0f};
    std::array<float, 3> gyroscope_{};
    const std::array<float, 4>& quaternion() const { return quaternion_; }
    const std::array<float, 3>& gyroscope() const { return gyroscope_; }
};
struct Motor {
    float q_ = 0.0f, dq_ = 0.0f;
    float q() const { return q_; }
    float dq() const { return dq_; }
};
struct Message {
    Imu imu;
    std::array<Motor, 35> motors;
    const Imu& imu_state() const { return imu; }
    const std::array<Motor, 35>& motor_state() const { return motors; }
};
struct LowState {
    Message msg_;
    std::mutex mutex_;
    unitree::common::UnitreeJoystick joystick;
};

// The program's runner; keeps what it was given.
struct Runner : isaaclab::OrtRunner {
    using isaaclab::OrtRunner::OrtRunner;
    std::vector<float> act(Observed observed) override {
        seen = first(observed);
        return OrtRunner::act(observed);
    }
    std::vector<float> seen;
};

static void print(const std::vector<float>& values) {
    std::printf("%zu ", values.size());
    for (float value : values) std::printf("%.9g ", value);
}

// A stick held so that its smoothed value is this one.
static void hold(unitree::common::Axis& axis, float value) {
    axis.smooth = 1.0f;
    axis.deadzone = 0.0f;
    axis(value);
}

int main(int count, char** words) {
    if (count != 3) return std::fprintf(stderr, "usage: unitree_rl_lab_steps FOLDER STATES\n"), 2;
    const std::string folder = words[1];
    const auto low = std::make_shared<LowState>();
    const YAML::Node cfg = YAML::LoadFile(folder + "/params/deploy.yaml");
    using Robot = unitree::BaseArticulation<std::shared_ptr<LowState>>;
    std::unique_ptr<isaaclab::ManagerBasedRLEnv> env;
    Runner* runner = nullptr;
    std::ifstream states(words[2]);
    for (std::string line; std::getline(states, line);) {
        std::istringstream numbers(line);
        Message& message = low->msg_;
        for (float& value : message.imu.quaternion_) numbers >> value;
        for (float& value : message.imu.gyroscope_) numbers >> value;
        float ly = 0.0f, lx = 0.0f, rx = 0.0f;
        numbers >> ly >> lx >> rx;
        hold(low->joystick.ly, ly);
        hold(low->joystick.lx, lx);
        hold(low->joystick.rx, rx);
        for (Motor& motor : message.motors) numbers >> motor.q_ >> motor.dq_;
        if (!env) {  // as State_RLBase does on entering its state
            env = std::make_unique<isaaclab::ManagerBasedRLEnv>(cfg, std::make_shared<Robot>(low));
            auto own = std::make_unique<Runner>(folder + "/exported/policy.onnx");
            runner = own.get();
            env->alg = std::move(own);
            env->robot->update();
            env->reset();
        }
        env->step();
        print(runner->seen);
        print(env->action_manager->action());
        print(env->action_manager->processed_actions());
        std::printf("\n");
    }
    return 0;
}
