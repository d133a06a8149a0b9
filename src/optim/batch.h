// The photographs of a step where it looks at several: which process looks at which, and what they
// find, added up in the order of the photographs. So neither the number of processes nor who is
// first has a say in the bits.  [docs/guide/ranks.md]
#pragma once

#include <cstring>

#include "core/scan.h"
#include "optim/train_state.h"

namespace tvsgs {

/// What one photograph, or all of a step, says of the splats.
struct SplatFindings {
    GeometrySpans geometry;
    Vec3f* sh;                     // coefficient major
    std::size_t stride;            // splats
    int coefficients;              // in use
    GrowthStatistics* statistics;  // null: not asked for

    /// Words of a record: the splat's place in its part, its geometry, its statistics, its
    /// harmonics.
    static constexpr int kFixedWords = 16;
    TVSGS_HD int words() const { return kFixedWords + 3 * coefficients; }
};

/// visit(word, float) for the findings of one splat: of its geometry, of its harmonics, or of both;
/// `word` is the place in a record.
template <class Visit>
TVSGS_HD void visit_geometry(const SplatFindings& f, int i, const Visit& visit) {
    const auto vector = [&visit](int word, Vec3f& v) {
        visit(word, v.x), visit(word + 1, v.y), visit(word + 2, v.z);
    };
    vector(1, f.geometry.means[i]);
    vector(4, f.geometry.log_scales[i]);
    Quatf& q = f.geometry.quats[i];
    visit(7, q.w), visit(8, q.x), visit(9, q.y), visit(10, q.z);
    visit(11, f.geometry.opacity_logits[i]);
}
template <class Visit>
TVSGS_HD void visit_harmonics(const SplatFindings& f, int i, const Visit& visit) {
    for (int k = 0; k < f.coefficients; ++k) {
        Vec3f& v = f.sh[static_cast<std::size_t>(k) * f.stride + static_cast<std::size_t>(i)];
        const int word = SplatFindings::kFixedWords + 3 * k;
        visit(word, v.x), visit(word + 1, v.y), visit(word + 2, v.z);
    }
}
template <class Visit>
TVSGS_HD void visit_floats(const SplatFindings& f, int i, const Visit& visit) {
    visit_geometry(f, i, visit);
    visit_harmonics(f, i, visit);
}

/// What one photograph says.
struct PhotographFindings : SplatFindings {
    Span<const float> radii;  // > 0: in view, as all are that it says something of the colours of

    /// What is not finite is something, too.
    TVSGS_HD bool any(int i) const {
        bool any = statistics != nullptr && statistics[i].views > 0;
        const auto look = [&any](int, float value) { any |= !(value == 0); };
        visit_geometry(*this, i, look);
        if (!any && radii[i] > 0) visit_harmonics(*this, i, look);
        return any;
    }
};

TVSGS_HD inline void add(GrowthStatistics& sum, const GrowthStatistics& s) {
    sum.gradient += s.gradient, sum.abs_gradient += s.abs_gradient, sum.views += s.views;
    sum.max_radius_px = sum.max_radius_px < s.max_radius_px ? s.max_radius_px : sum.max_radius_px;
}

/// One more than there are splats, 0 at the end.
struct TouchedBody {
    PhotographFindings found;
    Span<int> touched;
    TVSGS_HD void operator()(int i) const { touched[i] = i + 1 < touched.size() && found.any(i); }
};

/// Records, word major: records[word * count + j]. Takes what it packs: zeros are left.
struct PackBody {
    SplatFindings found;
    int begin, part_begin;  // of these splats, and of the part that they belong to
    Span<const int> first;  // of all splats, how many are touched before it
    int before;             // before these
    std::uint32_t* records;
    std::size_t count;
    TVSGS_HD void operator()(int j) const {
        const int i = begin + j;
        if (first[i] == first[i + 1]) return;
        std::uint32_t* const at = records + (first[i] - before);
        const auto put = [at, n = count](int word, const auto& value) {
            static_assert(sizeof value == sizeof *at);
            memcpy(at + static_cast<std::size_t>(word) * n, &value, sizeof value);
        };
        put(0, i - part_begin);
        visit_floats(found, i, [&put](int word, float& value) {
            put(word, value);
            value = 0;
        });
        const GrowthStatistics none{0, 0, 0, 0},
            &s = found.statistics == nullptr ? none : found.statistics[i];
        put(12, s.gradient), put(13, s.abs_gradient), put(14, s.views), put(15, s.max_radius_px);
    }
};

/// Adds records of different splats.
struct AddRecordsBody {
    const std::uint32_t* records;
    std::size_t count;
    SplatFindings sum;
    TVSGS_HD void operator()(int j) const {
        const auto get = [at = records + j, n = count](int word, auto& value) {
            memcpy(&value, at + static_cast<std::size_t>(word) * n, sizeof value);
        };
        int i = 0;
        get(0, i);
        visit_floats(sum, i, [&get](int word, float& total) {
            float value = 0;
            get(word, value);
            total += value;
        });
        if (sum.statistics == nullptr) return;
        GrowthStatistics s;
        get(12, s.gradient), get(13, s.abs_gradient), get(14, s.views), get(15, s.max_radius_px);
        add(sum.statistics[i], s);
    }
};

/// The same for what lies in this process, and is taken from there.
struct AddFindingsBody {
    PhotographFindings found;
    SplatFindings sum;

    TVSGS_HD static void take(float& value, float& total) {
        total += value;
        value = 0;
    }
    TVSGS_HD static void take(Vec3f& value, Vec3f& total) {
        take(value.x, total.x), take(value.y, total.y), take(value.z, total.z);
    }
    TVSGS_HD void operator()(int i) const {
        if (!found.any(i)) return;
        const GeometrySpans &from = found.geometry, &to = sum.geometry;
        take(from.means[i], to.means[i]);
        take(from.log_scales[i], to.log_scales[i]);
        Quatf &q = from.quats[i], &total = to.quats[i];
        take(q.w, total.w), take(q.x, total.x), take(q.y, total.y), take(q.z, total.z);
        take(from.opacity_logits[i], to.opacity_logits[i]);
        const auto at = static_cast<std::size_t>(i);
        for (int k = 0; k < found.coefficients; ++k)
            take(found.sh[static_cast<std::size_t>(k) * found.stride + at],
                 sum.sh[static_cast<std::size_t>(k) * sum.stride + at]);
        if (sum.statistics != nullptr) add(sum.statistics[i], found.statistics[i]);
    }
};

/// values[i] <- the mean of numbers[i], numbers[width + i], ..., one for each photograph.
struct MeanNumbersBody {
    const double* numbers;
    int width, photographs;
    double* values;
    TVSGS_HD void operator()(int i) const {
        double sum = 0;
        for (int b = 0; b < photographs; ++b) sum += numbers[b * width + i];
        values[i] = sum / photographs;
    }
};

struct AddNumbersBody {
    const double* from;
    Span<double> to;
    TVSGS_HD void operator()(int i) const { to[i] += from[i]; }
};

template <class Device>
class StepBatch {
public:
    /// `at_a_time`: splats of each process's part whose records are under way at a time; 0: as
    /// kExchangesOfPhotograph and kLeastExchanged have it.
    explicit StepBatch(Communicator* peers, int at_a_time = 0)
        : peers_(peers), at_a_time_(at_a_time) {}

    /// In the place of Iteration::propagate() for iterations [first, last], a photograph each:
    /// leaves the sum of their gradients in gradients() and the mean of their losses in the
    /// iteration, adds up what they say about growth, and lets the terms learn from each.
    void propagate(
        int first, int last, Iteration<Device>& iteration, Training<Device>& t, bool for_step) {
        Gaussians<Device>& g = t->gaussians;
        const int count = last - first + 1, ranks = size_of(peers_);
        measure(t);
        iteration.begin_step(last);
        const int own = own_part(peers_, g.size()).size();
        resize(sum_, own, g.sh_degree);
        fill_zero(sum_);
        counts_ = t->densifier.sums_at(last, g);
        numbers_.resize(static_cast<std::size_t>(count * width_));
        for (int begin = 0; begin < count; begin += ranks) {
            const int mine = begin + rank_of(peers_), number = first + mine;
            const bool there = mine < count;
            t->adam.begin_photograph();
            if (there) {
                const int after =
                    mine + ranks < count ? number + ranks : last + 1 + rank_of(peers_);
                look(number, last, after, iteration, t, for_step);
            } else {
                t->adam.answer_others(g);
            }
            if (peers_ != nullptr)
                iteration.clock("records", [&] { find_touched(there, iteration, g.size()); });
            iteration.clock("losses of others", [&] { gather_numbers(begin, there); });
            iteration.clock("sum of gradients",
                            [&] { add_splats(there, iteration, g.size(), t->adam.on_its_way()); });
            if (there) iteration.gradients_are_taken();
        }
        parallel_for(Device{}, static_cast<int>(t->losses.size()),
                     MeanNumbersBody{numbers_.data(), width_, count, iteration.values().data()});
        for (int b = 0; b < count; ++b) tell(first + b, numbers_.data() + b * width_, t);
    }

    /// Of the step, of this process's part of the splats.
    Gaussians<Device>& gradients() { return sum_; }

private:
    /// What a photograph says in numbers: values of the terms, their lessons, the derivatives by
    /// its camera.
    void measure(Training<Device>& t) {
        const auto terms = static_cast<int>(t->losses.size());
        lessons_.clear();
        width_ = terms;
        for (const auto& term : t->losses) {
            lessons_.push_back(width_);
            if (const auto* const lesson = term->lesson())
                width_ += static_cast<int>(lesson->size());
        }
        by_camera_ = width_;
        width_ += kCameraNumbers;
        mine_.resize(static_cast<std::size_t>(width_));
    }

    /// This process's photograph.
    void look(int number,
              int step,
              int after,
              Iteration<Device>& iteration,
              Training<Device>& t,
              bool for_step) {
        const DeviceView<Device>& view =
            iteration.fetch(number, t->sampler.view(number), t->losses,
                            [&] { return std::pair(after, t->sampler.view(after)); });
        mine_.fill_zero();
        const bool moves = !t->cameras.gradient_of(number, view.index).empty();
        iteration.propagate(
            number, step, view, t->gaussians, t->losses, t->field, for_step,
            moves ? Span<double>{mine_.data() + by_camera_, kCameraNumbers} : Span<double>{},
            [&](auto& values) {
                put(values, 0);
                for (std::size_t i = 0; i < t->losses.size(); ++i)
                    if (const auto* const lesson = t->losses[i]->lesson())
                        put(*lesson, lessons_[i]);
            });
        if (counts_ == nullptr) return;
        seen_.resize(t->gaussians.means.size());
        seen_.fill_zero();
        t->densifier.count_view(iteration.backbone().statistics(), seen_);
    }

    void put(const Buffer<double, Device>& from, int at) {
        detail::copy(Device{}, from.data(), Device{}, mine_.data() + at,
                     from.size() * sizeof(double));
    }

    /// Of all processes: the numbers of their photographs, and for whom they have how many records.
    void gather_numbers(int begin, bool there) {
        double* const to = numbers_.data() + begin * width_;
        if (peers_ == nullptr)
            return detail::copy(Device{}, mine_.data(), Device{}, to,
                                mine_.size() * sizeof(double));
        // Few enough to go by way of the host; up to 26 numbers are one exchange.
        std::vector<double> mine = there ? to_host(mine_) : std::vector<double>{};
        mine.insert(mine.begin(), records_to_.begin(), records_to_.end());
        std::vector<std::byte> all;
        peers_->all_gather_v("losses", mine.data(), mine.size() * sizeof(double), all);
        std::vector<double> said(all.size() / sizeof(double)), numbers;
        std::memcpy(said.data(), all.data(), all.size());
        const std::ptrdiff_t ranks = peers_->size(),
                             photographs = (std::ssize(said) - ranks * ranks) / width_;
        records_of_.clear();
        auto at = said.begin();
        for (std::ptrdiff_t r = 0; r < ranks; ++r) {
            records_of_.emplace_back(at, at + ranks), at += ranks;
            const std::ptrdiff_t width = r < photographs ? width_ : 0;  // the first ranks have one
            numbers.insert(numbers.end(), at, at + width), at += width;
        }
        detail::copy(Cpu{}, numbers.data(), Device{}, to, numbers.size() * sizeof(double));
    }

    SplatFindings findings(Gaussians<Device>& gradients,
                           Buffer<GrowthStatistics, Device>* statistics,
                           const Iteration<Device>& iteration) {
        return {geometry_spans(gradients), gradients.sh.data(), gradients.means.size(),
                sh_count(iteration.sh_degree()),
                statistics == nullptr ? nullptr : statistics->data()};
    }
    PhotographFindings findings_of_photograph(Iteration<Device>& iteration) {
        return {findings(iteration.gradients(), counts_ == nullptr ? nullptr : &seen_, iteration),
                iteration.backbone().statistics().radii_px.span()};
    }

    /// Of most splats a photograph says nothing. first_ <- how many before each it says something
    /// of, records_to_ <- how many of each process's part.
    void find_touched(bool there, Iteration<Device>& iteration, int splats) {
        const int ranks = peers_->size();
        records_to_.assign(static_cast<std::size_t>(ranks), 0);
        if (!there) return;
        touched_.resize(static_cast<std::size_t>(splats) + 1);
        parallel_for(Device{}, splats + 1,
                     TouchedBody{findings_of_photograph(iteration), touched_.span()});
        exclusive_scan(touched_, first_, scratch_);
        edges_.resize(records_to_.size() + 1);
        parallel_for(Device{}, ranks + 1,
                     PartEdgesBody<int>{std::as_const(first_).span(), ranks, edges_.data()});
        before_part_ = to_host(edges_);
        for (std::size_t r = 0; r < records_to_.size(); ++r)
            records_to_[r] = before_part_[r + 1] - before_part_[r];
    }

    /// Adds the photographs of this round: records go to the processes whose part they are of.
    void add_splats(bool there,
                    Iteration<Device>& iteration,
                    int splats,
                    OnItsWay<Device>& records) {
        const SplatFindings sum = findings(sum_, counts_, iteration);
        if (peers_ == nullptr)
            return parallel_for(Device{}, splats,
                                AddFindingsBody{findings_of_photograph(iteration), sum});
        const auto words = static_cast<std::size_t>(sum.words());
        const int ranks = peers_->size(), longest = longest_part(splats, ranks),
                  at_a_time = splats_at_a_time(splats, longest, ranks);
        for (int done = 0; done < longest; done += at_a_time) {
            const std::vector<std::size_t> to =
                there ? pack_records(done, at_a_time, splats, findings_of_photograph(iteration),
                                     records.sent)
                      : std::vector<std::size_t>(static_cast<std::size_t>(ranks) + 1, 0);
            std::vector<std::size_t> from;
            if (at_a_time >= longest) {  // all know how many records there are
                from = received_begins(records_of_, peers_->rank(), words);
                peers_->deal_known("gradients", records.sent, to, records.come, from);
            } else {
                from = peers_->all_to_all_v("gradients", records.sent, to, records.come);
            }
            for (std::size_t r = 0; r + 1 < from.size(); ++r) {
                const std::size_t count = (from[r + 1] - from[r]) / words;
                parallel_for(Device{}, static_cast<int>(count),
                             AddRecordsBody{records.come.data() + from[r], count, sum});
            }
        }
    }

    static int longest_part(int splats, int ranks) {
        int longest = 0;
        for (int r = 0; r < ranks; ++r)
            longest = std::max(longest, part_of(splats, r, ranks).size());
        return longest;
    }

    /// Of each part: all where there is room for the records, as exchanges take their time.
    int splats_at_a_time(int splats, int longest, int ranks) const {
        if (at_a_time_ > 0) return at_a_time_;
        if (goes_at_once(records_of_, splats)) return longest;
        return std::max(kLeastExchanged / ranks, longest / kExchangesOfPhotograph) + 1;
    }

    /// records <- those of the splats [done, done + at_a_time) of each part, one part after the
    /// other; returns where each begins, words.
    std::vector<std::size_t> pack_records(int done,
                                          int at_a_time,
                                          int splats,
                                          const SplatFindings& found,
                                          Buffer<std::uint32_t, Device>& records) {
        const int ranks = peers_->size();
        const auto before = [&](int splat) {
            for (int r = 0; r <= ranks; ++r)
                if (splat == (r < ranks ? part_of(splats, r, ranks).begin : splats))
                    return before_part_[static_cast<std::size_t>(r)];
            int count = 0;
            detail::copy(Device{}, first_.data() + splat, Cpu{}, &count, sizeof count);
            return count;
        };
        const auto words = static_cast<std::size_t>(found.words());
        std::vector<PackBody> pieces;
        std::vector<int> sizes;
        std::vector<std::size_t> begins{0};
        for (int r = 0; r < ranks; ++r) {
            const Part part = part_of(splats, r, ranks);
            const int begin = std::min(part.begin + done, part.end),
                      end = begin + std::min(at_a_time, part.end - begin), first = before(begin);
            const auto count = static_cast<std::size_t>(before(end) - first);
            pieces.push_back(
                {found, begin, part.begin, std::as_const(first_).span(), first, nullptr, count});
            sizes.push_back(end - begin);
            begins.push_back(begins.back() + words * count);
        }
        records.resize(begins.back());
        for (std::size_t r = 0; r < pieces.size(); ++r) {
            pieces[r].records = records.data() + begins[r];
            parallel_for(Device{}, sizes[r], pieces[r]);
        }
        return begins;
    }

    /// The training hears of a photograph, on every process alike.
    void tell(int number, double* numbers, Training<Device>& t) {
        const int view = t->sampler.view(number);
        if (const Span<double> to = t->cameras.gradient_of(number, view); !to.empty())
            parallel_for(Device{}, kCameraNumbers, AddNumbersBody{numbers + by_camera_, to});
        for (std::size_t i = 0; i < t->losses.size(); ++i)
            if (t->losses[i]->lesson() != nullptr && t->losses[i]->active(number))
                t->losses[i]->learn(number, view, numbers + lessons_[i]);
        t.watch(number, view, {numbers, t->losses.size()});
    }

    Communicator* peers_;
    int at_a_time_;
    Gaussians<Device> sum_;
    Buffer<GrowthStatistics, Device>* counts_ = nullptr;  // of this step; null: not asked for
    Buffer<GrowthStatistics, Device> seen_;               // of this process's photograph
    int width_ = 0, by_camera_ = 0;                       // of the numbers of a photograph
    std::vector<int> lessons_;                            // where those of a term begin
    Buffer<double, Device> mine_, numbers_;               // [width], [photographs width]
    Buffer<int, Device> touched_, first_, edges_;         // [N + 1], [N + 1], [processes + 1]
    Buffer<std::uint8_t, Device> scratch_;
    std::vector<int> before_part_;  // records for the parts before it; all of them
    std::vector<int> records_to_;   // of this process's photograph, for each process
    SentCounts records_of_;         // the same of each process
};

}  // namespace tvsgs
