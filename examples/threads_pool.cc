/* threads_pool: a cone map built by a pool of C++ threads that stay up between passes, as an engine's job system does. The
   pool knows nothing of conemap.h; parallel_for is the only bridge. */
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"

#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

class Pool {
public:
    explicit Pool(unsigned threads) {
        for (unsigned k = 1; k < threads; ++k) workers_.emplace_back([this] { live(); });
    }
    ~Pool() {
        {
            std::lock_guard<std::mutex> guard(lock_);
            stop_ = true;
        }
        wake_.notify_all();
        for (std::thread &worker : workers_) worker.join();
    }
    Pool(const Pool &) = delete;
    Pool &operator=(const Pool &) = delete;

    /* Runs job(0) .. job(count - 1), this thread among the workers, and returns when all are done. */
    void run(int count, const std::function<void(int)> &job) {
        std::unique_lock<std::mutex> guard(lock_);
        job_ = &job;
        next_ = 0;
        count_ = left_ = count;
        wake_.notify_all();
        take(guard);
        done_.wait(guard, [this] { return left_ == 0; });
        job_ = nullptr;
    }

private:
    void take(std::unique_lock<std::mutex> &guard) {
        while (next_ < count_) {
            const std::function<void(int)> &job = *job_;
            int index = next_++;
            guard.unlock();
            job(index);
            guard.lock();
            if (--left_ == 0) done_.notify_all();
        }
    }
    void live() {
        std::unique_lock<std::mutex> guard(lock_);
        for (;;) {
            wake_.wait(guard, [this] { return stop_ || next_ < count_; });
            if (stop_) return;
            take(guard);
        }
    }

    std::vector<std::thread> workers_;
    std::mutex lock_;
    std::condition_variable wake_, done_;
    const std::function<void(int)> *job_ = nullptr;
    int next_ = 0, count_ = 0, left_ = 0;
    bool stop_ = false;
};

/* desc.parallel_for: user is the pool. */
static void parallel_for(int count, conemap_job *job, void *context, void *user) {
    static_cast<Pool *>(user)->run(count, [=](int index) { job(context, index); });
}

int main() {
    const int side = 512;
    const unsigned processors = std::thread::hardware_concurrency(), threads = processors > 0 ? processors : 2;
    std::vector<unsigned char> heights(static_cast<size_t>(side) * side);
    for (size_t k = 0; k < heights.size(); ++k)
        heights[k] = static_cast<unsigned char>((k % side * 7 ^ k / side * 5) & 255u);
    conemap_desc desc = conemap_desc();
    desc.heights.pixels = heights.data();
    desc.heights.format = CONEMAP_UNORM8;
    desc.heights.width = desc.heights.height = side;
    conemap_map alone, together;
    if (conemap_build(&desc, &alone) != CONEMAP_OK) return 1;
    Pool pool(threads);
    desc.parallel_for = parallel_for;
    desc.parallel_user = &pool;
    if (conemap_build(&desc, &together) != CONEMAP_OK) return 1;
    const bool same = std::memcmp(alone.cones, together.cones, sizeof(float) * heights.size()) == 0;
    std::printf("%u threads: %s\n", threads, same ? "the same bits as one" : "DIFFERENT BITS");
    conemap_free(&alone);
    conemap_free(&together);
    return !same;
}
