// What the programs that learn contact laws from trajectories compile once.
#pragma once

#include <rbres/learn/hybrid_law.hpp>
#include <rbres/learn/identify.hpp>
#include <rbres/learn/learn_contacts.hpp>

namespace rbres {

namespace contacts_program {
using Law = ContactLaw<>;
using Hybrid = HybridLaw<>;
}  // namespace contacts_program

extern template Identification identify<>(const TrajectorySet&, const IdentifyOptions&);
extern template contacts_program::Law learn_contacts(const TrajectorySet&, const TrajectorySet&,
                                                     const ContactLearning&, const ContactLearningCallback&);
extern template contacts_program::Hybrid learn_contacts(const TrajectorySet&, const TrajectorySet&,
                                                        const ContactLearning&,
                                                        const ContactLearningCallback&);

}  // namespace rbres
