// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/exact_sum.hpp"

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace talus::parallel {

/// The processes ("ranks") of one run. By default one alone, for which every call returns at once and MPI is
/// never started. Collective calls are to be made by all ranks in the same order, by the thread that made the
/// object.
class Communicator {
public:
    /// One process alone.
    Communicator() = default;
    /// All that a launcher (mpirun, srun) started together; alone where none did. Starts MPI; the last copy
    /// ends it.
    static Communicator world();

    int rank() const { return rank_; }
    int size() const { return size_; }
    bool alone() const { return size_ == 1; }
    /// Points to the MPI_Comm for libraries that take one; null where alone.
    const void* handle() const;

    /// Ends all ranks at once with this exit code: for errors that one rank found by itself.
    [[noreturn]] void abort(int code) const;

    /// Processors that this rank should use: those of its affinity mask, shared out among the ranks of this
    /// machine that have the same mask.
    int fair_threads(int available) const;

    /// Bits that any rank has set.
    unsigned any(unsigned bits) const;
    std::uint64_t sum(std::uint64_t value) const; ///< modulo 2^64
    void sum(std::span<std::uint64_t> values) const;
    double max(double value) const;
    void max(std::span<double> values) const; ///< each by itself
    double min(double value) const;
    /// Exact, so the same bits on any number of ranks.
    void sum(std::span<ExactSum> sums) const;
    void broadcast(void* data, std::size_t bytes) const; ///< rank 0's
    /// The words of the lowest rank that has any; empty where none has.
    std::string first_words(const std::string& words) const;

    /// Everybody's value, by rank.
    template <class T>
    std::vector<T> gather(const T& value) const {
        static_assert(std::is_trivially_copyable_v<T>);
        std::vector<T> all(static_cast<std::size_t>(size_), value);
        gather_bytes(&value, all.data(), sizeof(T));
        return all;
    }

    /// Sends to[r] to rank r; returns what came, in the order of the senders' ranks.
    template <class T>
    std::vector<T> exchange(const std::vector<std::vector<T>>& to) const {
        static_assert(std::is_trivially_copyable_v<T>);
        std::vector<std::size_t> ignored;
        return exchange(to, ignored);
    }
    /// The same; [start[r], start[r + 1]) came from rank r.
    template <class T>
    std::vector<T> exchange(const std::vector<std::vector<T>>& to, std::vector<std::size_t>& start) const {
        static_assert(std::is_trivially_copyable_v<T>);
        std::vector<Message> out;
        for (std::size_t r = 0; r < to.size(); ++r)
            if (!to[r].empty())
                out.push_back({static_cast<int>(r), const_cast<T*>(to[r].data()), to[r].size() * sizeof(T)});
        const std::vector<Arrival> arrivals = exchange_bytes(out);
        start.assign(to.size() + 1, 0);
        for (const Arrival& a : arrivals)
            start[static_cast<std::size_t>(a.rank) + 1] = a.bytes.size() / sizeof(T);
        for (std::size_t r = 0; r < to.size(); ++r)
            start[r + 1] += start[r];
        std::vector<T> received(start.back());
        for (const Arrival& a : arrivals)
            std::memcpy(static_cast<void*>(received.data() + start[static_cast<std::size_t>(a.rank)]),
                        a.bytes.data(), a.bytes.size());
        return received;
    }

    struct Message {
        int rank;
        void* data;
        std::size_t bytes;
    };
    /// Sends and receives; both sides know the sizes. Empty messages are left out.
    void transfer(std::span<const Message> out, std::span<const Message> in) const;

    /// `transfer` and `any` under way at the same time; `data` must stay until `finish`.
    class Pending;
    void start(Pending& pending, std::span<const Message> out, std::span<const Message> in,
               unsigned bits) const;
    /// Waits; returns the bits that any rank has set.
    unsigned finish(Pending& pending) const;

private:
    void gather_bytes(const void* value, void* all, std::size_t bytes) const;
    struct Arrival {
        int rank;
        std::vector<std::byte> bytes;
    };
    std::vector<Arrival> exchange_bytes(std::span<const Message> out) const;

    struct State;
    std::shared_ptr<State> state_;
    int rank_ = 0, size_ = 1;
};

class Communicator::Pending {
public:
    Pending();
    ~Pending();
    Pending(const Pending&) = delete;
    Pending& operator=(const Pending&) = delete;

private:
    friend class Communicator;
    struct Requests;
    std::unique_ptr<Requests> requests_;
};

} // namespace talus::parallel
