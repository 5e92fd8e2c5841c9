//! The quadrature rule of a panel: Gauss-Legendre nodes, with the running integral and the highest Legendre coefficients
//! of the polynomial through the values.

use std::sync::LazyLock;

/// Nodes of a panel: exact for polynomials of degree 19, and over the stretches of
/// [`super::medium::Medium::exact_stretch`] to rounding for every kernel. With fewer, sparse gas costs more halvings; with
/// more, dense gas costs nodes that its short panels do not need.
pub(super) const NODES: usize = 10;

/// One value per node.
pub(super) type Values = [f64; NODES];

/// Gauss-Legendre quadrature on [-1, 1] (Abramowitz & Stegun, 25.4.29), and what the polynomial through the values tells.
pub(super) struct Rule {
    /// The nodes, ascending.
    pub x: Values,
    /// Their weights, which sum to 2.
    pub weight: Values,
    /// Row j: weights of the integral from -1 to node j of the polynomial through the values.
    running: [Values; NODES],
    /// Weights of the two highest Legendre coefficients of that polynomial.
    highest: [Values; 2],
}

/// The rule; made once.
pub(super) static RULE: LazyLock<Rule> = LazyLock::new(Rule::new);

impl Rule {
    fn new() -> Self {
        let mut x = [0.0; NODES];
        let mut weight = [0.0; NODES];
        for (i, (x, weight)) in x.iter_mut().zip(&mut weight).enumerate() {
            // Newton's iteration for the roots of P_n from Tricomi's estimate; it converges quadratically.
            let mut root = -((i as f64 + 0.75) / (NODES as f64 + 0.5) * std::f64::consts::PI).cos();
            for _ in 0..8 {
                let p = legendre(root);
                root -= p[NODES] / slope(&p, root);
            }
            *x = root;
            *weight = 2.0 / ((1.0 - root * root) * slope(&legendre(root), root).powi(2));
        }
        let p = x.map(legendre);
        // The coefficient a_n = (2n + 1)/2 sum of w_l P_n(x_l) f_l; the rule is exact for the products that this needs.
        let coefficient = |n: usize, l: usize| (n as f64 + 0.5) * weight[l] * p[l][n];
        // The integral of P_n from -1 to x is x + 1 for n = 0, else [P_(n+1) - P_(n-1)] / (2n + 1).
        let integral =
            |n: usize, j: usize| if n == 0 { x[j] + 1.0 } else { (p[j][n + 1] - p[j][n - 1]) / (2 * n + 1) as f64 };
        let running = std::array::from_fn(|j| {
            std::array::from_fn(|l| (0..NODES).map(|n| coefficient(n, l) * integral(n, j)).sum())
        });
        let highest = [NODES - 2, NODES - 1].map(|n| std::array::from_fn(|l| coefficient(n, l)));
        Self { x, weight, running, highest }
    }

    /// Integral over [-1, 1].
    #[inline]
    pub(super) fn integral(&self, values: &Values) -> f64 {
        dot(&self.weight, values)
    }

    /// Integrals from -1 to each node.
    #[inline]
    pub(super) fn running(&self, values: &Values) -> Values {
        std::array::from_fn(|j| dot(&self.running[j], values))
    }

    /// Sum of the sizes of the two highest Legendre coefficients: while coefficients fall, what the polynomial through the
    /// values differs from the function by. Two of them, since every other one of an even or odd function vanishes.
    #[inline]
    pub(super) fn tail(&self, values: &Values) -> f64 {
        dot(&self.highest[0], values).abs() + dot(&self.highest[1], values).abs()
    }
}

#[inline]
fn dot(a: &Values, b: &Values) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// P_0 to P_NODES at `x`, by Bonnet's recursion.
fn legendre(x: f64) -> [f64; NODES + 1] {
    let mut p = [1.0; NODES + 1];
    p[1] = x;
    for n in 1..NODES {
        let m = n as f64;
        p[n + 1] = ((2.0 * m + 1.0) * x * p[n] - m * p[n - 1]) / (m + 1.0);
    }
    p
}

/// Slope of P_NODES at `x` inside (-1, 1), from the values of [`legendre`].
fn slope(p: &[f64; NODES + 1], x: f64) -> f64 {
    NODES as f64 * (p[NODES - 1] - x * p[NODES]) / (1.0 - x * x)
}
