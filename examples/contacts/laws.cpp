#include "laws.hpp"

namespace rbres {

template Identification identify<>(const TrajectorySet&, const IdentifyOptions&);
template contacts_program::Law learn_contacts(const TrajectorySet&, const TrajectorySet&,
                                              const ContactLearning&, const ContactLearningCallback&);
template contacts_program::Hybrid learn_contacts(const TrajectorySet&, const TrajectorySet&,
                                                 const ContactLearning&, const ContactLearningCallback&);

}  // namespace rbres
