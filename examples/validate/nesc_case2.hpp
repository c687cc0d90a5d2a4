#pragma once

/// Check case 2 of NASA/TM-2015-218675 (NASA Engineering and Safety Center: Check-cases for verification of
/// 6-degree-of-freedom flight vehicle simulations): a tumbling brick without damping. Values of simulation 4,
/// as published with nasa/simupy-flight.
namespace validate::nesc_case2 {

inline constexpr double inertia[3] = {0.001894220, 0.006211019,
                                      0.007194665};  ///< slug ft^2; torque-free: any unit

/// Body rates (roll, pitch, yaw) at 0, 3, ..., 30 s, deg/s.
inline constexpr double rates[11][3] = {
    {10.0, 20.0, 30.0},
    {-7.65791414981, 21.6324912928, 29.1927340225},
    {-18.5264678196, 0.5271105109, 34.3661858748},
    {-8.2905704485, -21.2457762267, 29.3917315247},
    {9.39062210776, -20.4797136405, 29.7715840064},
    {18.4372543136, 2.38688029893, 34.3107056116},
    {6.522892621, 22.2354654431, 28.8724523764},
    {-11.0519913164, 19.0684191313, 30.4234892344},
    {-18.0722661079, -5.25321665064, 34.0855954074},
    {-4.71440329359, -22.9741985295, 28.4629107619},
    {12.6183907757, -17.3974747619, 31.1195888868},
};

/// At 30 s: Euler angles from the local north-east-down frame, and where that frame is, deg.
inline constexpr double yaw = -4.28935504226, pitch = -3.81965492189, roll = -56.1513075938,
                        longitude = 5.74552213287E-5;
inline constexpr double earth_rate = 7.292115e-5;  ///< rad/s

}  // namespace validate::nesc_case2
