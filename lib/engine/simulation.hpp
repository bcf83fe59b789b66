// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/tensor.hpp"
#include "base/thread_team.hpp"
#include "engine/advance.hpp"
#include "engine/pair_kernel.hpp"
#include "engine/scene.hpp"
#include "engine/sleep.hpp"
#include "engine/time_step.hpp"
#include "engine/triaxial.hpp"
#include "engine/wall_contacts.hpp"
#include "engine/wall_record.hpp"
#include "parallel/communicator.hpp"
#include "parallel/domains.hpp"
#include "parallel/halo.hpp"
#include "parallel/periodic_images.hpp"
#include "particles/grains.hpp"
#include "search/candidate_list.hpp"
#include "search/local_motion.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace talus::engine {

/// Where the energy is, J. kinetic + potential + elastic + dissipated - supplied stays what it was at the
/// start
/// (`total`), up to the error of the integration.
struct Energies {
    double kinetic = 0;    ///< translation and rotation
    double potential = 0;  ///< of gravity, against the start
    double elastic = 0;    ///< normal springs
    double tangential = 0; ///< taken in by tangential springs, dashpots and sliders
    double damping = 0;    ///< normal dashpots and viscous damping
    double fracture = 0;   ///< stored in bonds as they broke
    double asleep = 0;     ///< kinetic, taken from particles that fell asleep
    double supplied = 0;   ///< work of moving walls, of the pressure on a membrane, and of shaking
    double total() const {
        return kinetic + potential + elastic + tangential + damping + fracture + asleep - supplied;
    }
};

/// How near to rest the scene is.
struct RestState {
    double unbalanced_force = 0;         ///< mean net force on mobile particles / mean contact force
    double max_speed = 0, rms_speed = 0; ///< m/s
    double coordination_number = 0;      ///< 2 contacts / mobile particles, walls not counted
};

/// State by particle id, as files want it: of this rank's block of ids (see Simulation).
struct Snapshot {
    std::vector<Vec3> position, velocity, angular_velocity, force;
};

/// Everything that the next step depends on, in storage-independent form: particles by id, contacts by id
/// pair. A rank has its block of ids, the contacts and wall contacts of which it has the first particle, and
/// (like all) the ledger and the scalars; put together in the order of ranks it is the same on any number of
/// ranks.
struct SavedState {
    std::int64_t step = 0;
    std::vector<Vec3> position, half_velocity, half_angular_velocity, acceleration, angular_acceleration;
    std::vector<float> damping_load; ///< that comes with `acceleration`; half_kick has the one before
    std::vector<HalfKick> half_kick;
    std::vector<std::array<std::int32_t, 3>> image;
    std::vector<std::array<std::uint64_t, 2>> contact_pair;
    std::vector<std::array<std::int8_t, 3>>
        contact_image; ///< box lengths of the second against the first, wrapped positions
    std::vector<Vec3> contact_displacement;
    std::vector<double> contact_offset;
    std::vector<std::uint8_t> contact_state;
    std::vector<std::array<std::uint64_t, 2>> wall_pair; ///< id, WallContacts::key
    std::vector<Vec3> wall_displacement;
    std::vector<double> wall_offset;
    std::vector<std::uint8_t> wall_state;
    std::vector<std::int64_t> wall_sums; ///< of WallRecord
    std::vector<double> wall_peaks;
    std::vector<std::int64_t> ledger; ///< the exact sums' bits
    std::vector<double> scalars;      ///< reference energy, largest energy, ...
    // Of a scene that sleeps, one rank.
    std::vector<std::uint8_t> asleep;                       ///< by id
    std::vector<float> sleep_reference;                     ///< by id
    std::vector<std::array<std::int64_t, 3>> sleep_balance; ///< by id
    std::vector<std::uint8_t> sleep_quiet;                  ///< by cell
    std::vector<double> sleep_scalars;
    std::vector<std::array<double, 4>> sleep_audited; ///< id and position of those under audit
};

/// A discrete element run: the step of physics.md over one domain, or over the domains of several ranks. Time
/// integration is velocity Verlet with the forces' velocities predicted to the full step and the tangential
/// history advanced with half-step velocities and normals: second order throughout.
///
/// Between steps: positions at the full step t, velocities at t - dt/2. Forces at t are computed in the next
/// step, in one sweep with the move that they cause, or as soon as somebody asks for anything that depends on
/// them.
///
/// With several ranks each computes the particles in its part of space and has copies of those near by; pairs
/// of two ranks' particles are computed on both, with the same bits. All public members but the plain
/// getters are then collective: to be called by all ranks in the same order. What goes in and out by particle
/// is in blocks of ids: rank r has [first_id(), first_id() + block_size()), the grains it was given.
class Simulation {
public:
    /// @throws Error(configuration_invalid) for a step above the stable limit, a box too small for its
    /// grains,
    ///         Error(input_invalid) for grains that are not numbers or outside the box.
    /// @param grains this rank's block: the model's particles are those of rank 0, then those of rank 1, ...
    Simulation(const Scene& scene, const Grains& grains, ThreadTeam& team,
               const parallel::Communicator& world = {});
    ~Simulation();

    /// One time step, read top-down like the paper: push, add up, move, list.
    void step();
    /// One time step, at whose end space is stretched: the edges of the periodic box and all positions are
    /// multiplied by `factor` along each axis, the box's lower corner staying where it is. Velocities go on
    /// as they are: from then on they count against the mean deformation, and so do dashpots and viscous
    /// damping, which do not resist it. Contacts take up what the stretch shears them by (nothing where it is
    /// the same along all axes). Any factor is safe for the lists; one that brings grains together by more
    /// than a small part of their radius at once is not for the physics.
    ///
    /// The energy ledger does not know the work done: energy_error() means nothing afterwards. A state saved
    /// is to be restored into a scene with the box() of that moment.
    /// @param factor 1 along open directions
    /// @throws Error(configuration_invalid) on several ranks, with walls or fixed grains, for a factor that
    /// is not
    ///         positive or along an open direction, or where the box would become too small for its grains
    void step_and_strain(const Vec3& factor);
    /// Computes the forces at the present time, where that has not been done; all that reports state does it.
    void evaluate();

    std::size_t size() const { return block_start_.back(); } ///< particles of all ranks
    std::uint64_t first_id() const { return block_start_[rank()]; }
    std::size_t block_size() const { return block_start_[rank() + 1] - block_start_[rank()]; }
    /// What this rank has to do and where its time went since the start, where there are several.
    struct RankLoad {
        double busy = 0;                     ///< s of computing forces and moves, processor time
        double lists = 0;                    ///< s of making lists, wall time
        double exchange = 0;                 ///< s of exchanging the halo and waiting for others, wall time
        std::size_t particles = 0;           ///< computed here now
        std::size_t halo = 0;                ///< copies of others'
        std::size_t halo_bytes_per_step = 0; ///< out and in
        std::size_t neighbours = 0;
    };
    RankLoad rank_load() const;
    std::size_t recuts() const { return recuts_; } ///< how often domains were cut anew
    std::size_t mobile_count() const { return mobile_; }

    /// For whoever must decide alike on all ranks: bits that any rank has asked for before the last step.
    void ask(unsigned bits) { asking_ |= bits; }
    unsigned asked() const { return asked_; }
    /// Whether it holds on any rank.
    bool any_rank(bool here) const { return world_.any(here) != 0; }

    std::int64_t steps() const { return step_; }
    double time() const { return static_cast<double>(step_) * time_step_.step; }
    const TimeStep& time_step() const { return time_step_; }
    const std::string& kernel_name() const { return kernel_.name; }

    /// Breaks every bond between a grain of the released mass (of any of the marks' bits) and one outside it,
    /// with `whole_mass` also those between two of the mass; returns how many.
    std::size_t release(bool whole_mass = false, std::uint8_t marks = 0xff);
    /// A stage begins: triggers that count from it start their clocks. They act from the next step on.
    void begin_stage(const std::string& name);
    /// Of the ground in a scene with shaking, now.
    GroundMotion ground_motion() const;
    /// Of each strength reduction, as of the last step that forces were computed at.
    std::vector<double> strength_factors() const { return evaluated().weakened_; }
    void set_viscous_damping(double per_second) { viscous_damping_ = per_second; }

    /// A stage of a triaxial test begins: see TriaxialTest.
    void begin_triaxial(Stage::Kind kind);
    /// Of a scene with `triaxial`.
    TriaxialMeasures triaxial_measures() const;
    /// Whether the present stage of a triaxial test has come to its end.
    bool triaxial_done(double time_in_stage) const;
    /// A grain that stands outside the membrane, by id; none where all are inside.
    std::optional<std::uint64_t> outside_membrane() const;

    /// How much slept, and at what error: the mean over all looks of |change of force since it fell asleep|
    /// of the sleepers with awake partners, over what their contacts carried then. Zero without sleep.
    SleepReport sleep_report() const;

    Energies energies() const;
    /// |total now - total at the start| / largest kinetic + elastic + dissipated + potential change so far.
    double energy_error() const;
    RestState rest_state() const;
    /// The box as it is now; its periodic edges are rounded to the grid of parallel::PeriodicImages.
    const Box& box() const { return images_.box(); }
    /// Symmetric part of the stress that pairs transmit, by rows, Pa, compression positive: the sum over
    /// contacts of force (springs and dashpots, normal and tangential) times branch vector over the box's
    /// volume. Without the motion's part, nor that of walls.
    Tensor contact_stress() const;
    bool at_rest(const RestState& state) const;
    Snapshot snapshot() const;
    /// Positions only, which need no forces: m, of this rank's block, as in snapshot().
    std::vector<Vec3> positions() const;
    struct WallLoad {
        Vec3 force, torque; ///< N; N m about the wall's point
    };
    std::vector<WallLoad> wall_loads() const;
    /// Of the scene's monitors; torques about the middles of their boxes.
    std::vector<WallLoad> monitor_loads() const;
    /// Impulses, peaks and pressure maps of all walls since the start.
    std::vector<WallReport> wall_reports() const;

    std::size_t contacts() const {
        return world_.sum(evaluated().contacts_ + (sleep_ ? sleep_->contacts : 0));
    }
    std::size_t candidates() const { return world_.sum(list_.size()); }
    /// Whether present lists follow each particle's own motion instead of the mean around it.
    bool own_ways() const { return motion_.own(); }
    std::size_t outer_candidates() const { return world_.sum(list_.outer_size()); }
    std::size_t bonds() const;
    std::size_t list_rebuilds() const { return rebuilds_; }
    /// How often the close list was made anew from the outer one.
    std::size_t list_refreshes() const { return refreshes_; }
    /// Bytes held for particles, pairs and lists.
    std::size_t memory() const;
    /// Bonds broken since the last call, in the order of (step, i, j), as far as forces have been computed;
    /// all of them on rank 0, none on the others.
    std::vector<BondBreak> take_breaks();

    SavedState save() const;
    /// The two halves of a saved state: what belongs to particles, with the step; and contacts with all the
    /// rest.
    void save_particles(SavedState& state) const;
    void save_contacts(SavedState& state) const;
    /// The parts of the state go as they are used: give it away where memory counts.
    void restore(SavedState state);
    /// Gives contacts the tangential displacements that they have in a packing. Rows with neither a contact
    /// here are refused as in restore(); contacts without a row start from zero.
    /// @param contacts of this rank's block (i in it), i < j by id; images as of positions wrapped into the
    /// box
    void adopt_histories(const ContactTable& contacts);

private:
    /// A pair's history on its way to another rank or into another list.
    struct CarriedPair {
        search::KeyedPair key;
        contact::History history;
    };
    struct CarriedWall {
        std::uint64_t id, wall;
        contact::History history;
    };
    struct Carried {
        std::vector<CarriedPair> pairs;
        std::vector<CarriedWall> walls;
        bool restored = false;      ///< from a checkpoint, of
        std::uint64_t expected = 0; ///< contacts in all

        /// By key, each once: several ranks send the same.
        void sort_pairs();
    };
    /// Pairs whose forces are computed before the particles they complete are moved: 16 kB of forces.
    static constexpr std::size_t sweep_block = search::CandidateList::block;
    /// Blocks whose records are kept before their slots are used again: 320 kB.
    static constexpr std::size_t ring_blocks = 20;

    std::size_t rank() const { return static_cast<std::size_t>(world_.rank()); }
    void load(const Grains& grains);
    void reduce_properties(std::optional<QuickestGrain>& quickest);
    void make_constants();
    void make_apparatus(const Grains& grains);
    void set_initial_contacts();
    void start_from_full_step();
    const Simulation& evaluated() const {
        const_cast<Simulation*>(this)->evaluate(); // a value kept for later, nothing that can be seen
        return *this;
    }
    void move();
    void move_late(const AdvanceWork& work);
    /// Cuts pairs and rows among the threads for the sweep: body(pair begin, end, row begin, end, thread).
    template <class Body>
    void for_sweep_parts(Body&& body) {
        team_.for_parts(
            list_.size(), active_,
            [&](std::size_t begin, std::size_t end, bool last, int thread) {
                body(begin, end, begin == 0 ? 0 : std::min(list_.row_at(begin), active_),
                     last ? active_ : std::min(list_.row_at(end), active_), thread);
            },
            sweep_block);
    }
    void find_late_rows();
    /// Slot of a block's first record, in its thread's ring.
    static std::size_t first_slot(std::size_t thread, std::size_t block) {
        return (thread * ring_blocks + block % ring_blocks) * sweep_block;
    }
    void finish_move();
    void advance_time(const Vec3* strain);
    void check_strain(const Vec3& factor) const;
    void strain_cell(const Vec3& factor);
    void strain_contacts(const Vec3& factor);
    std::size_t count_bonds() const;
    void keep_lists_valid();
    unsigned agree(unsigned bits);
    struct Displacement {
        double outer = 0; ///< of a particle's share of the outer skin, with its close share
        double used = 0;  ///< of a particle's share of the close skin
        double walls = 0; ///< m, towards a wall since the outer list was made
    };
    Displacement largest_displacement();
    static double shortened(const Vec3& factor);
    double half_reach() const;
    double largest_outer_share() const;
    void choose_ways();
    double hit_way(std::size_t row) const;
    search::CandidateList::Ahead ahead() const;
    void set_outer_shares();
    void set_shares();
    Vec3 moved_since_listed(std::size_t row) const;
    Vec3 moved_against_others(std::size_t row) const;
    void take_close_list();
    void adapt_skins(bool outer);
    void rebuild(bool all_bonds) { rebuild(all_bonds, Carried()); }
    void rebuild(bool all_bonds, Carried carried);
    void mark_pairs_counted_elsewhere();
    void refresh();
    search::CandidateList::Live live() const;
    void compute_forces(double history_step);
    void for_blocks(double history_step, const AdvanceWork& work, bool add_forces);
    void add_contact(const search::Candidate& pair, const Vec3& force, Tally& tally) const;
    void assign_slots();
    double record_scale() const;
    void record_walls(bool first);
    void add_to_monitors(const search::Candidate& pair, const Vec3& force, Tally& tally) const;
    void check_monitors() const;
    AdvanceWork advance_work(const NetColumns* given, NetColumns* into);
    [[noreturn]] void stop_at_bad_particle() const;
    void check_passing() const;
    std::string near_particles(std::size_t row) const;
    void add_viscous_power();
    void set_onsets();
    Vec3 body_acceleration() const;
    void add_shaking_power(ExactSum& power);
    void weaken();
    TriaxialTest::Shape specimen_shape() const;
    double platen_force(std::size_t wall) const;
    void press_membrane();
    void feel_apparatus();
    void drive_platen();
    Vec3 unwrapped(std::size_t row) const;
    Vec3 full_velocity(std::size_t row) const;
    Vec3 full_angular_velocity(std::size_t row) const;
    void collect_tallies(bool first);

    // Sleep (sleepers.cpp).
    void prepare_sleep();
    void look_for_sleep();
    void look_at_awake();
    void look_at_border();
    void look_at_walls();
    void audit_sleep();
    void judge(std::uint32_t cell, std::uint8_t verdict);
    void wake_cells(const std::vector<std::uint32_t>& cells);
    void regroup_between_steps();
    void wake_for_release(std::uint8_t marks);
    void look_at_triggers();
    std::vector<std::uint8_t> rows_that_stay_awake() const;
    using Wrapped = std::vector<std::array<std::int8_t, 3>>;
    std::vector<std::uint32_t> regroup(Wrapped& wrapped, Carried& carried);
    void put_to_sleep(const std::vector<std::uint8_t>& change, const Wrapped& wrapped);
    void find_border();
    std::size_t sleep_memory() const;
    double sleepers_unseen_for(double reach) const;
    void settle_balances(int sign);
    Sleepers::Quanta border_force(std::size_t begin, std::size_t end) const;
    Vec3 static_force(std::size_t pair, const Wrapped* wrapped = nullptr) const;
    std::array<std::int8_t, 3> pair_shift(const search::Candidate& c, const Wrapped* wrapped) const;
    void count_sleeping_pair(const contact::History& history, std::uint32_t i, std::uint32_t j,
                             const std::array<std::int8_t, 3>& shift, int sign);
    void count_sleeper(std::size_t row, int sign);
    bool is_asleep(std::size_t row) const;
    Vec3 stored_position(const SleepStore::Particle& particle) const;
    std::array<std::int8_t, 3> lengths_outside(std::uint32_t row) const;
    void save_pairs(SavedState& state) const;
    void save_sleep(SavedState& state) const;
    void restore_sleep(const SavedState& state);

    // Several ranks (ranks.cpp).
    /// What must be the same before and after particles changed rank, summed over all ranks.
    struct Census {
        std::uint64_t particles = 0, ids = 0, pairs = 0, keys = 0;
        void add_pair(std::uint64_t i, std::uint64_t j, bool bonded);
    };
    template <class Weight>
    void cut_by(Weight weight);
    void cut_domains();
    void recut_where_unbalanced();
    std::vector<int> destinations() const;
    /// Sends particles with their histories where they belong. `wrapped` and what is returned as rebuild()
    /// has them.
    std::vector<std::uint32_t> change_ranks(std::vector<std::array<std::int8_t, 3>>& wrapped,
                                            Carried& carried);
    Census count_all() const;
    void give_walls(const std::vector<CarriedWall>& walls);
    void check_census(const Census& before, const Census& dropped) const;
    void update_halo();
    void share_motion();
    std::size_t home_of(std::uint64_t id) const;
    /// Rank that owns each particle of this rank's block.
    std::vector<int> owners_of_block() const;
    template <class Make, class Take>
    void send_home(Make make, Take take) const;
    template <class Make, class Take>
    void send_to_owners(Make make, Take take) const;
    Carried take_contacts(SavedState& state) const;

    Scene scene_;
    ThreadTeam& team_;
    parallel::Communicator world_;
    ConstantsTable constants_;
    KernelChoice kernel_;
    parallel::PeriodicImages images_;
    parallel::Domains domains_;
    parallel::Halo halo_;
    ParticleColumns particles_;
    PairColumns pairs_;
    search::CandidateList list_;
    WallContacts walls_;
    WallRecord wall_record_;
    Membrane membrane_;
    std::optional<TriaxialTest> triaxial_;
    std::unique_ptr<Sleepers> sleep_; ///< where anything may sleep
    TimeStep time_step_;

    std::int64_t step_ = 0, last_rebuild_ = 0, last_refresh_ = 0;
    double reach_factor_ = 1, bond_reach_ = 0, largest_radius_ = 0, smallest_radius_ = 0, mean_radius_ = 0;
    double skin_ = 0, close_skin_ = 0; ///< m; the least share of a particle is half the first, the second
    double wider_ = 1;                 ///< factor on the widest share of the outer skin
    double used_ = 0;                  ///< the largest part of his share that anybody can have used up
    double wall_skin_ = 0;             ///< m, from which on walls are listed
    double shear_use_ = 0;             ///< 1/s, the largest part of a share that the local motion uses up
    double wall_travel_ = 0;           ///< m, of the walls since the outer list was made
    double wall_used_ = 0;             ///< m, by which anybody can have come nearer to a wall since then
    double viscous_damping_ = 0;
    std::vector<double> onsets_;         ///< s, at which the triggers' clocks began: shaking, then weakenings
    std::vector<double> weakened_;       ///< present factor of each strength reduction
    ConstantsTable full_strength_;       ///< constants_ before any weakening
    bool straining_ = false;             ///< space has been stretched: step_and_strain()
    Vec3 strain_since_rebuild_{1, 1, 1}; ///< factors since the outer list was made
    Vec3 strain_since_refresh_{1, 1, 1}; ///< and since the close list was
    double least_share_ = 0;             ///< m, of the close skin
    bool current_ = false;               ///< the forces are those at the present time
    std::uint64_t id_sum_ = 0;           ///< over hashes of all ranks' particles' ids
    std::vector<std::uint64_t> block_start_{0, 0}; ///< first id of each rank's block
    unsigned asking_ = 0, asked_ = 0;
    double busy_ = 0, lists_time_ = 0, exchange_time_ = 0; ///< s, see RankLoad
    double busy_at_look_ = 0;                              ///< s
    std::int64_t last_look_ = 0;                           ///< step
    bool was_unbalanced_ = false;                          ///< then
    std::size_t recuts_ = 0;
    std::size_t mobile_ = 0, contacts_ = 0, rebuilds_ = 0, refreshes_ = 0;
    std::size_t active_ = 0;       ///< rows from here on do not move: fixed and sleeping ones
    search::LocalMotion motion_;   ///< when the outer list was made
    double motion_holds_for_ = 0;  ///< s, on all ranks
    std::int64_t steps_ahead_ = 8; ///< for which lists are made where particles go their own ways
    Vec3 listed_origin_;
    double listed_rounding_ = 0; ///< m, of listed_
    std::vector<std::array<float, 3>>
        listed_; ///< m, positions against the origin when the outer list was made
    std::vector<std::array<float, 3>> refreshed_; ///< m, moved_against_others() when the close list was made
    std::vector<float> outer_share_;              ///< m, the same of the outer list
    std::vector<float> share_; ///< m, by which a particle may move before the close list is made anew
    std::vector<std::uint32_t>
        close_ghosts_; ///< those in the close list: the others are brought up with the lists
    std::vector<std::size_t> complete_rows_; ///< rows whose pairs all stand before the k-th block of pairs
    std::vector<std::uint8_t> hold_;         ///< [known] rows that do not move with the sweep
    std::vector<std::vector<std::uint32_t>> late_; ///< by thread: rows that wait for pairs of others
    NetColumns net_;                       ///< what acts at the present time, where the forces are current
    ExactSum contact_force_;               ///< N, sum over pairs of the magnitudes then
    std::array<ExactSum, 6> virial_;       ///< N m, over pairs, see Tally
    std::vector<std::uint32_t> far_pairs_; ///< whose records outlive the ring, in rising order
    std::vector<std::size_t> far_start_;   ///< the first of each block
    std::vector<Advanced> advanced_;       ///< by thread
    std::vector<Tally> tallies_;
    std::vector<BondBreak> breaks_;
    /// Powers (W) integrated by the trapezoidal rule, and one energy (J) lost in jumps.
    struct Integral {
        ExactSum sum, first, last;
    };
    enum Power { damping_power, tangential_power, viscous_power, supplied_power, powers };
    std::array<Integral, powers> integrals_;
    ExactSum fractured_;
    double start_potential_ = 0, start_energy_ = 0;
    mutable double largest_energy_ = 0;
};

} // namespace talus::engine
