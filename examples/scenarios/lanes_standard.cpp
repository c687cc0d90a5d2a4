#include "compiled.hpp"

template double paper::simulate_in_lanes<rbres::BodySet::standard>(rbres::World,
                                                                   const std::vector<rbres::Scenario>&,
                                                                   const rbres::SimulationOptions&);
template void rbres::detail::generate_piece(const rbres::ScenarioSampler<rbres::BodySet::standard>&,
                                            std::uint64_t, Eigen::Index, Eigen::Index,
                                            const rbres::TruthOptions&, rbres::ScenarioData&);
