// SPDX-License-Identifier: Apache-2.0
// The singular value decomposition of a small square matrix by one-sided Jacobi rotations (Hestenes; accuracy: Demmel and
// Veselic). Eigen's two-sided ones take several times as long for a 6 x 6 matrix: docs/results/native_core.md.

#pragma once

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace plsing {

// matrix = left diag(values) right', values largest first; real or complex, then with the conjugate of right'.
template <int Size, typename Scalar = double>
class JacobiSvd {
public:
    using Matrix = Eigen::Matrix<Scalar, Size, Size>;
    using Vector = Eigen::Matrix<double, Size, 1>;

    JacobiSvd() = default;

    // The matrix is finite, its largest element about one, so that squares do not overflow; values below 1e-65, for
    // which products of squares underflow, become zero. It converges fastest for the transpose of a triangular factor of
    // a decomposition with pivots. Columns of zeros at the right stay there.
    // Without `with_right` that one stays the identity, which saves a part of the time.
    explicit JacobiSvd(const Matrix &matrix, bool with_right = true)
        : left(matrix), right(Matrix::Identity())
    {
        for (int sweep = 0; sweep < max_sweeps && !rotate_all_pairs(with_right); sweep++) {}
        int rank = 0;
        for (int i = 0; i < Size; i++) {
            const double square = left.col(i).squaredNorm();
            values(i) = square > nothing ? std::sqrt(square) : 0.0;
            if (values(i) == 0.0)
                continue;
            left.col(i) *= 1.0 / values(i);
            rank = i + 1;
        }
        if (rank == 0)
            left.setIdentity();
        else if (rank < Size)
            complete(rank);
    }

    Matrix left, right;
    Vector values;

private:
    static constexpr int max_sweeps = 60;
    static constexpr double nothing = 1e-130;
    // A square of a cosine that is zero to rounding.
    static constexpr double orthogonal = 1e-31;

    // Make each pair of columns orthogonal, the longer one first; return whether all were.
    bool rotate_all_pairs(bool with_right)
    {
        bool done = true;
        Vector square = left.colwise().squaredNorm();
        // In rounds of pairs that share no column, so that the processor can rotate them at the same time.
        constexpr int rounds = Size - 1 + Size % 2;
        for (int round = 0; round < rounds; round++)
            for (int i = 0; i <= rounds / 2; i++) {
                const int before = round - i < 0 ? round - i + rounds : round - i;
                const int after = i == 0 ? rounds : round + i < rounds ? round + i : round + i - rounds;
                const int p = std::min(before, after), q = std::max(before, after);
                if (q >= Size)
                    continue;
                if (square(p) < square(q)) {
                    std::swap(square(p), square(q));
                    left.col(p).swap(left.col(q));
                    if (with_right)
                        right.col(p).swap(right.col(q));
                    done = false;
                }
                const Scalar product = left.col(p).dot(left.col(q));
                const double squared = Eigen::numext::abs2(product);
                if (square(q) < nothing || squared <= orthogonal * square(p) * square(q))
                    continue;
                const double gap = square(p) - square(q), size = std::sqrt(gap * gap + 4.0 * squared);
                const double cosine = std::sqrt(0.5 * (gap + size) / size), scale = -2.0 / (gap + size);
                const Scalar sine = cosine * scale * product;
                const auto rotate = [&](Matrix &matrix) {
                    const Eigen::Matrix<Scalar, Size, 1> one = matrix.col(p), other = matrix.col(q);
                    matrix.col(p) = cosine * one - Eigen::numext::conj(sine) * other;
                    matrix.col(q) = sine * one + cosine * other;
                };
                rotate(left);
                if (with_right)
                    rotate(right);
                square(p) -= scale * squared;
                square(q) += scale * squared;
                done = false;
            }
        return done;
    }

    // Make the columns from `rank` on orthonormal to those before them.
    void complete(int rank)
    {
        using Columns = Eigen::Matrix<Scalar, Size, Eigen::Dynamic, Eigen::ColMajor, Size, Size>;
        const Eigen::HouseholderQR<Columns> qr(left.leftCols(rank));
        const Matrix all = qr.householderQ() * Matrix::Identity();
        left.rightCols(Size - rank) = all.rightCols(Size - rank);
    }
};

}  // namespace plsing
