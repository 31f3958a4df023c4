// Boost.Fiber's channels and fibers in the scenarios of the benches.
//
// usage: boost-fiber-peer SCENARIO OPERATIONS [SIZE]; prints the nanoseconds that the operations took.
#include <boost/fiber/all.hpp>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

using Channel = boost::fibers::unbuffered_channel<std::uint64_t>;
using boost::fibers::fiber;

static void expect(std::uint64_t value, std::uint64_t expected) {
    if (value != expected) {
        std::fprintf(stderr, "%lu instead of %lu\n", (unsigned long)value, (unsigned long)expected);
        std::_Exit(1);
    }
}

// Performs this many operations after a warm-up, and prints the elapsed time. Fibers that never end are abandoned with the program.
template <class Operation> [[noreturn]] static void timed(long operations, double scale, Operation operation) {
    for (long i = 0; i < operations / 16 + 1; i++) operation();
    auto start = std::chrono::steady_clock::now();
    for (long i = 0; i < operations; i++) operation();
    std::chrono::duration<double, std::nano> elapsed = std::chrono::steady_clock::now() - start;
    std::printf("%f\n", elapsed.count() * scale);
    std::fflush(stdout);
    std::_Exit(0);
}

static std::uint64_t take(Channel &channel) {
    std::uint64_t value = 0;
    channel.pop(value);
    return value;
}

[[noreturn]] static void commstime(long operations) {
    Channel a, b, c, d;
    fiber prefix([&] { a.push(0); for (;;) a.push(take(c)); });
    fiber delta([&] { for (;;) { auto x = take(a); d.push(x); b.push(x); } });
    fiber successor([&] { for (;;) c.push(take(b) + 1); });
    std::uint64_t next = 0;
    timed(operations, 1, [&] { expect(take(d), next++); });
}

[[noreturn]] static void yielding(long operations) {
    fiber other([] { for (;;) boost::this_fiber::yield(); });
    timed(operations / 2, 1, [] { boost::this_fiber::yield(); });
}

[[noreturn]] static void rendezvous(long operations) {
    Channel channel;
    fiber sender([&] { for (std::uint64_t i = 0;; i++) channel.push(i); });
    std::uint64_t next = 0;
    timed(operations, 1, [&] { expect(take(channel), next++); });
}

[[noreturn]] static void ring(long operations, long size) {
    std::vector<std::unique_ptr<Channel>> channels;
    std::vector<fiber> fibers;
    channels.push_back(std::make_unique<Channel>());
    for (long i = 1; i < size; i++) {
        channels.push_back(std::make_unique<Channel>());
        Channel &in = *channels[i - 1], &out = *channels[i];
        fibers.emplace_back(std::allocator_arg, boost::fibers::fixedsize_stack(16384),
                            [&in, &out] { for (;;) out.push(take(in) + 1); });
    }
    long laps = (operations + size - 1) / size;
    timed(laps, double(operations) / double(laps * size), [&] {
        channels.front()->push(0);
        expect(take(*channels.back()), size - 1);
    });
}

[[noreturn]] static void spawn(long operations) {
    timed(operations, 1, [] { fiber([] {}).join(); });
}

int main(int, char **arguments) {
    std::string scenario = arguments[1];
    long operations = std::atol(arguments[2]);
    if (scenario == "commstime") commstime(operations);
    if (scenario == "switch") yielding(operations);
    if (scenario == "rendezvous") rendezvous(operations);
    if (scenario == "ring") ring(operations, std::atol(arguments[3]));
    if (scenario == "spawn") spawn(operations);
    std::fprintf(stderr, "unknown scenario %s\n", arguments[1]);
    return 2;
}
