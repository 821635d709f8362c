//! The printed report: one row a case, one pair of columns an instruction set.

use sspc_kernels::simd::Isa;

/// Worst errors of one case on one instruction set, relative as the table's title says.
#[derive(Clone, Copy, Debug, Default)]
pub struct Worst {
    pub value: f64,
    pub gradient: f64,
}

impl Worst {
    pub fn of_value(&mut self, got: f32, truth: f64, scale: f64) {
        self.value = worse(self.value, got, truth, scale);
    }

    pub fn of_gradient(&mut self, got: f32, truth: f64, scale: f64) {
        self.gradient = worse(self.gradient, got, truth, scale);
    }
}

/// The larger of `so_far` and |got - truth| / scale; NaN and Inf are the worst of all.
fn worse(so_far: f64, got: f32, truth: f64, scale: f64) -> f64 {
    let error = (f64::from(got) - truth).abs() / scale;
    if error.is_nan() { f64::INFINITY } else { so_far.max(error) }
}

/// Rows of a table that is printed whole, so that tables of parallel tests do not mix.
pub struct Table {
    text: String,
    limit: Worst,
    failures: Vec<String>,
}

impl Table {
    /// A table whose errors must stay below `limit`.
    pub fn new(title: &str, limit: Worst) -> Self {
        let names: String = Isa::available().iter().map(|isa| format!("{:>20}", isa.name())).collect();
        let text = format!(
            "\n{title}; limits {:.0e} (value), {:.0e} (gradient)\n{:34}{names}\n",
            limit.value, limit.gradient, "case"
        );
        Self { text, limit, failures: Vec::new() }
    }

    /// Measures a case on every instruction set.
    pub fn row(&mut self, case: &str, measure: impl Fn(Isa) -> Worst) {
        self.text += &format!("{case:34}");
        for isa in Isa::available() {
            let worst = measure(isa);
            self.text += &format!("{:>10.1e}{:>10.1e}", worst.value, worst.gradient);
            if !(worst.value < self.limit.value && worst.gradient < self.limit.gradient) {
                self.failures.push(format!("{case} on {}: {worst:?}", isa.name()));
            }
        }
        self.text += "\n";
    }

    /// Prints the table; fails when any error was above its limit.
    pub fn finish(self) {
        println!("{}", self.text);
        assert!(self.failures.is_empty(), "{}{:#?}", self.text, self.failures);
    }
}
