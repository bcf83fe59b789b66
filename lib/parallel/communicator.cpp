// SPDX-License-Identifier: GPL-3.0-or-later
#include "parallel/communicator.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <mpi.h>
#include <sched.h>
#include <unistd.h>

namespace talus::parallel {

struct Communicator::State {
    MPI_Comm world = MPI_COMM_NULL;
    int exchanges = 0;
    ~State() {
        int ended = 0;
        MPI_Finalized(&ended);
        if (!ended)
            MPI_Finalize();
    }
};

struct Communicator::Pending::Requests {
    std::vector<MPI_Request> list;
    unsigned mine = 0, all = 0;
};

namespace {

/// Messages above this size (bytes) go in parts: MPI counts with int.
constexpr std::size_t largest_message = std::size_t{1} << 30;

bool started_by_launcher() {
    for (const char* variable : {"OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "PMI_SIZE"})
        if (std::getenv(variable) != nullptr)
            return true;
    return false;
}

/// One part of a message, for a request each.
template <class Post>
void in_parts(const Communicator::Message& message, Post post) {
    for (std::size_t at = 0; at < message.bytes; at += largest_message)
        post(static_cast<char*>(message.data) + at,
             static_cast<int>(std::min(largest_message, message.bytes - at)));
}

constexpr int tag = 1;
/// Of sparse exchanges, in turns: a rank may begin the next one while another still looks for messages.
constexpr int first_exchange_tag = 2;

} // namespace

Communicator Communicator::world() {
    Communicator c;
    if (!started_by_launcher())
        return c;
    auto state = std::make_shared<State>();
    int provided = 0;
    MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided);
    if (provided < MPI_THREAD_FUNNELED)
        throw Error(ExitCode::run_failed, "this MPI library does not allow threads: install one that does");
    state->world = MPI_COMM_WORLD;
    MPI_Comm_rank(state->world, &c.rank_);
    MPI_Comm_size(state->world, &c.size_);
    c.state_ = std::move(state);
    return c;
}

const void* Communicator::handle() const {
    return alone() ? nullptr : &state_->world;
}

void Communicator::abort(int code) const {
    if (state_)
        MPI_Abort(state_->world, code);
    ::_exit(code);
}

int Communicator::fair_threads(int available) const {
    if (alone())
        return available;
    MPI_Comm machine = MPI_COMM_NULL;
    MPI_Comm_split_type(state_->world, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &machine);
    int ranks = 1;
    MPI_Comm_size(machine, &ranks);
    cpu_set_t mine;
    CPU_ZERO(&mine);
    sched_getaffinity(0, sizeof mine, &mine);
    std::vector<cpu_set_t> masks(static_cast<std::size_t>(ranks));
    MPI_Allgather(&mine, sizeof mine, MPI_BYTE, masks.data(), sizeof mine, MPI_BYTE, machine);
    MPI_Comm_free(&machine);
    const auto sharing = std::count_if(masks.begin(), masks.end(),
                                       [&](const cpu_set_t& other) { return CPU_EQUAL(&other, &mine); });
    return std::max(1, available / static_cast<int>(sharing));
}

unsigned Communicator::any(unsigned bits) const {
    if (!alone())
        MPI_Allreduce(MPI_IN_PLACE, &bits, 1, MPI_UNSIGNED, MPI_BOR, state_->world);
    return bits;
}

std::uint64_t Communicator::sum(std::uint64_t value) const {
    sum({&value, 1});
    return value;
}

void Communicator::sum(std::span<std::uint64_t> values) const {
    if (!alone())
        MPI_Allreduce(MPI_IN_PLACE, values.data(), static_cast<int>(values.size()), MPI_UINT64_T, MPI_SUM,
                      state_->world);
}

double Communicator::max(double value) const {
    max({&value, 1});
    return value;
}

void Communicator::max(std::span<double> values) const {
    if (!alone())
        MPI_Allreduce(MPI_IN_PLACE, values.data(), static_cast<int>(values.size()), MPI_DOUBLE, MPI_MAX,
                      state_->world);
}

double Communicator::min(double value) const {
    return -max(-value);
}

void Communicator::sum(std::span<ExactSum> sums) const {
    if (alone())
        return;
    // Digits of 32 bits in 64, so that 2^31 ranks add up without a carry; the last word counts overflows.
    constexpr std::size_t words = 5;
    std::vector<std::int64_t> digits(sums.size() * words);
    constexpr std::int64_t low32 = 0xffffffff;
    for (std::size_t k = 0; k < sums.size(); ++k) {
        const std::int64_t high = sums[k].high_bits(), low = sums[k].low_bits();
        std::int64_t* d = digits.data() + k * words;
        d[0] = low & low32;
        d[1] = (low >> 32) & low32;
        d[2] = high & low32;
        d[3] = high >> 32;
        d[4] = sums[k].overflowed();
    }
    MPI_Allreduce(MPI_IN_PLACE, digits.data(), static_cast<int>(digits.size()), MPI_INT64_T, MPI_SUM,
                  state_->world);
    for (std::size_t k = 0; k < sums.size(); ++k) {
        const std::int64_t* d = digits.data() + k * words;
        __int128 value = 0;
        for (const std::size_t w : {3u, 2u, 1u, 0u})
            value = value * (std::int64_t{1} << 32) + d[w];
        sums[k].set_bits(static_cast<std::int64_t>(value >> 64), static_cast<std::int64_t>(value));
        if (d[4] != 0)
            sums[k].set_overflowed();
    }
}

void Communicator::broadcast(void* data, std::size_t bytes) const {
    if (!alone())
        in_parts({0, data, bytes},
                 [&](void* part, int count) { MPI_Bcast(part, count, MPI_BYTE, 0, state_->world); });
}

std::string Communicator::first_words(const std::string& words) const {
    const std::vector<std::uint64_t> lengths = gather(std::uint64_t{words.size()});
    for (std::size_t rank = 0; rank < lengths.size(); ++rank) {
        if (lengths[rank] == 0)
            continue;
        std::string first = words;
        first.resize(lengths[rank]);
        if (!alone())
            MPI_Bcast(first.data(), static_cast<int>(first.size()), MPI_CHAR, static_cast<int>(rank),
                      state_->world);
        return first;
    }
    return "";
}

void Communicator::gather_bytes(const void* value, void* all, std::size_t bytes) const {
    if (!alone())
        MPI_Allgather(value, static_cast<int>(bytes), MPI_BYTE, all, static_cast<int>(bytes), MPI_BYTE,
                      state_->world);
}

/// Who sends whom is not known beforehand, and mostly few do: by non-blocking consensus (Hoefler, Siebert &
/// Lumsdaine, "Scalable communication protocols for dynamic sparse data exchange", PPoPP 2010), so that it
/// does not cost more with more ranks.
std::vector<Communicator::Arrival> Communicator::exchange_bytes(std::span<const Message> out) const {
    std::vector<Arrival> arrivals;
    std::vector<MPI_Request> sends;
    const int this_tag = alone() ? 0 : first_exchange_tag + (state_->exchanges++ & 1);
    for (const Message& message : out) {
        auto* data = static_cast<std::byte*>(message.data);
        if (message.rank == rank_)
            arrivals.push_back({rank_, {data, data + message.bytes}});
        else
            in_parts(message, [&](void* part, int count) {
                MPI_Issend(part, count, MPI_BYTE, message.rank, this_tag, state_->world,
                           &sends.emplace_back());
            });
    }
    if (alone())
        return arrivals;
    MPI_Request barrier = MPI_REQUEST_NULL;
    for (bool in_barrier = false, done = false; !done;) {
        int there = 0;
        MPI_Status status;
        MPI_Iprobe(MPI_ANY_SOURCE, this_tag, state_->world, &there, &status);
        if (there) {
            int count = 0;
            MPI_Get_count(&status, MPI_BYTE, &count);
            const auto from = std::find_if(arrivals.begin(), arrivals.end(),
                                           [&](const Arrival& a) { return a.rank == status.MPI_SOURCE; });
            Arrival& arrival =
                from != arrivals.end() ? *from : arrivals.emplace_back(Arrival{status.MPI_SOURCE, {}});
            const std::size_t had = arrival.bytes.size();
            arrival.bytes.resize(had + static_cast<std::size_t>(count));
            MPI_Recv(arrival.bytes.data() + had, count, MPI_BYTE, status.MPI_SOURCE, this_tag, state_->world,
                     MPI_STATUS_IGNORE);
        }
        int sent = 0, all = 0;
        if (in_barrier) {
            MPI_Test(&barrier, &all, MPI_STATUS_IGNORE);
        } else {
            MPI_Testall(static_cast<int>(sends.size()), sends.data(), &sent, MPI_STATUSES_IGNORE);
            if (sent) {
                MPI_Ibarrier(state_->world, &barrier);
                in_barrier = true;
            }
        }
        done = all != 0;
    }
    return arrivals;
}

void Communicator::transfer(std::span<const Message> out, std::span<const Message> in) const {
    Pending pending;
    start(pending, out, in, 0);
    if (!alone())
        MPI_Waitall(static_cast<int>(pending.requests_->list.size()), pending.requests_->list.data(),
                    MPI_STATUSES_IGNORE);
}

void Communicator::start(Pending& pending, std::span<const Message> out, std::span<const Message> in,
                         unsigned bits) const {
    std::vector<MPI_Request>& list = pending.requests_->list;
    list.clear();
    pending.requests_->mine = pending.requests_->all = bits;
    for (const Message& from : in)
        if (from.rank == rank_) { // to itself
            for (const Message& to : out)
                if (to.rank == rank_ && from.bytes > 0)
                    std::memcpy(from.data, to.data, from.bytes);
        } else {
            in_parts(from, [&](void* part, int count) {
                MPI_Irecv(part, count, MPI_BYTE, from.rank, tag, state_->world, &list.emplace_back());
            });
        }
    for (const Message& to : out)
        if (to.rank != rank_)
            in_parts(to, [&](void* part, int count) {
                MPI_Isend(part, count, MPI_BYTE, to.rank, tag, state_->world, &list.emplace_back());
            });
}

unsigned Communicator::finish(Pending& pending) const {
    if (alone())
        return pending.requests_->all;
    Pending::Requests& r = *pending.requests_;
    MPI_Iallreduce(&r.mine, &r.all, 1, MPI_UNSIGNED, MPI_BOR, state_->world, &r.list.emplace_back());
    MPI_Waitall(static_cast<int>(r.list.size()), r.list.data(), MPI_STATUSES_IGNORE);
    r.list.clear();
    return r.all;
}

Communicator::Pending::Pending() : requests_(std::make_unique<Requests>()) {}
Communicator::Pending::~Pending() = default;

} // namespace talus::parallel
