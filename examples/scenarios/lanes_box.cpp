#include "compiled.hpp"

template double paper::simulate_in_lanes<rbres::BodySet::box>(rbres::World,
                                                              const std::vector<rbres::Scenario>&,
                                                              const rbres::SimulationOptions&);
template void rbres::detail::generate_piece(const rbres::ScenarioSampler<rbres::BodySet::box>&, std::uint64_t,
                                            Eigen::Index, Eigen::Index, const rbres::TruthOptions&,
                                            rbres::ScenarioData&);
