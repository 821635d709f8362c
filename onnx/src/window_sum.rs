//! The sums of g_c over the window in standard operators.
//!
//! A Scan runs over the rows of the window; inside it the columns are unrolled. Only the row index is then dynamic (a
//! Gather of whole rows), a shift by a column is a Slice with constant bounds, and memory stays at a few planes. A loop
//! over all 361 offsets is slower in onnxruntime and not supported by tract; unrolling all of them takes gigabytes.

use crate::builder::{Dim, GraphBuilder, int, ints, subgraph, tensor};
use crate::messages::{GraphProto, data_type};

/// What the weights compare, in the contract's bandwidth order rho, n, v, y, z.
struct Term {
    /// Name of the values, `[N, C, H, W]`.
    value: &'static str,
    /// Name of minus its bandwidth, `[N, 1, H, W]`.
    bandwidth: &'static str,
    /// gamma log(1 + d) of a squared distance d of colours, gamma d of a feature.
    logarithmic: bool,
    /// Whether the weighted sum of the values is needed.
    summed: bool,
}

const TERMS: [Term; 5] = [
    Term { value: "rho", bandwidth: "minus_gamma_rho", logarithmic: false, summed: true },
    Term { value: "n", bandwidth: "minus_gamma_n", logarithmic: false, summed: true },
    Term { value: "v", bandwidth: "minus_gamma_v", logarithmic: false, summed: false },
    Term { value: "y", bandwidth: "minus_gamma_y", logarithmic: true, summed: true },
    Term { value: "z", bandwidth: "minus_gamma_z", logarithmic: true, summed: true },
];

/// From the values `rho`, `n`, `v`, `y`, `z`, the five `minus_gamma_*` and `tau` in `graph`, adds
/// `weight_sum` = sum w_i `[N, 1, H, W]` and, for rho, n, y and z, `*_sum` = sum w_i x_i
/// `[N, 3, H, W]` over the window (Eq. 11, tau at the centre).
pub(crate) fn add_window_sums(graph: &mut GraphBuilder, radius: usize) {
    mirrored_indices(graph, radius);
    for term in &TERMS {
        let padded = format!("{}_wide", term.value);
        graph.op_with("Gather", &[term.value, "column_indices"], &padded, vec![int("axis", 3)]);
    }
    let summed: Vec<&Term> = TERMS.iter().filter(|term| term.summed).collect();
    // burn-onnx 0.22 needs an initial value per sum and the constant outside the body.
    let mut inputs: Vec<String> = summed.iter().map(|term| zeros_like(graph, term.value)).collect();
    inputs.push(zeros_like(graph, "tau"));
    graph.floats("f_one", &[], &[1.0]);
    let centre: Vec<bool> = (0..=2 * radius).map(|row| row == radius).collect();
    // A tensor per row instead of a scalar, for the same reason.
    graph.bools("row_is_centre", &[centre.len(), 1, 1, 1, 1], &centre);
    inputs.extend(["window_rows", "row_is_centre"].map(String::from));
    let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
    let mut outputs: Vec<String> = summed.iter().map(|t| format!("{}_sum", t.value)).collect();
    outputs.push("weight_sum".into());
    let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
    let attributes = vec![subgraph("body", row_body(radius)), int("num_scan_inputs", 2)];
    graph.node("Scan", &inputs, &outputs, attributes);
}

/// Zeros of the shape of `value`.
fn zeros_like(graph: &mut GraphBuilder, value: &str) -> String {
    let shape = graph.op("Shape", &[value], &format!("{value}_shape"));
    // The value is ONNX's default, but tract 0.23 takes that default for float64.
    graph.op_with("ConstantOfShape", &[&shape], &format!("{value}_zeros"), vec![tensor("value", 0.0)])
}

/// `column_indices` `[W + 2 radius]`: the pixel that a padded column shows, mirrored at the borders with
/// the edge pixel repeated, as often as a small image needs. `window_rows` `[2 radius + 1, H]`: for each row
/// of the window the image row that each pixel sees.
fn mirrored_indices(graph: &mut GraphBuilder, radius: usize) {
    graph.op("Shape", &["y"], "image_shape");
    graph.ints("i_zero", &[], &[0]);
    graph.ints("i_one", &[], &[1]);
    graph.ints("i_two", &[], &[2]);
    graph.ints("radius", &[], &[radius as i64]);
    graph.ints("two_radii", &[], &[2 * radius as i64]);
    for (axis, name) in [(2, "row"), (3, "column")] {
        let n = |part: &str| format!("{name}_{part}");
        let axis = graph.ints(&n("axis"), &[], &[axis]);
        let size = graph.op("Gather", &["image_shape", &axis], &n("size"));
        let period = graph.op("Mul", &[&size, "i_two"], &n("period"));
        let padded = graph.op("Add", &[&size, "two_radii"], &n("padded"));
        let count = graph.op("Range", &["i_zero", &padded, "i_one"], &n("count"));
        // A multiple of the period that keeps the dividend from being negative, where engines
        // differ about the sign of Mod.
        let lift = graph.op("Mul", &[&period, "radius"], &n("lift"));
        let shift = graph.op("Sub", &[&lift, "radius"], &n("shift"));
        let lifted = graph.op("Add", &[&count, &shift], &n("lifted"));
        let forward = graph.op("Mod", &[&lifted, &period], &n("forward"));
        let turn = graph.op("Sub", &[&period, "i_one"], &n("turn"));
        let backward = graph.op("Sub", &[&turn, &forward], &n("backward"));
        graph.op("Min", &[&forward, &backward], &n("indices"));
    }
    let offsets: Vec<i64> = (0..=2 * radius as i64).collect();
    graph.ints("window_offsets", &[offsets.len(), 1], &offsets);
    graph.op("Range", &["i_zero", "row_size", "i_one"], "image_rows");
    graph.op("Add", &["window_offsets", "image_rows"], "padded_rows");
    graph.op("Gather", &["row_indices", "padded_rows"], "long_window_rows");
    // tract keeps values derived from a Shape in its own dimension type, which does not pass through a Scan as int64.
    let to = vec![int("to", data_type::INT32 as i64)];
    graph.op_with("Cast", &["long_window_rows"], "window_rows", to);
}

/// One row of the window, its columns unrolled. State: the sums; scanned: a row of `window_rows`
/// and of `row_is_centre`; everything else is seen from the graph around it.
fn row_body(radius: usize) -> GraphProto {
    let mut body = GraphBuilder::new("window_row");
    // Free, not named: tract treats equal names inside and outside the body as different sizes.
    let free = |channels| [Dim::Free, Dim::Size(channels), Dim::Free, Dim::Free];
    let summed: Vec<&Term> = TERMS.iter().filter(|term| term.summed).collect();
    for term in &summed {
        body.input(&format!("{}_sum_in", term.value), data_type::FLOAT, &free(3));
    }
    body.input("weight_sum_in", data_type::FLOAT, &free(1));
    body.input("rows", data_type::INT32, &[Dim::Free]);
    body.input("is_centre", data_type::BOOL, &[Dim::Size(1); 4]);

    body.ints("shift_axis", &[1], &[3]);
    for term in &TERMS {
        let wide = format!("{}_wide", term.value);
        let row = format!("{}_row", term.value);
        body.op_with("Gather", &[&wide, "rows"], &row, vec![int("axis", 2)]);
    }
    let mut sums: Vec<String> = summed.iter().map(|t| format!("{}_sum_in", t.value)).collect();
    let mut weight_sum = String::from("weight_sum_in");
    for column in 0..=2 * radius {
        let name = |part: &str| match column {
            last if last == 2 * radius => format!("{part}_out"),
            _ => format!("{part}_{column}"),
        };
        let taps = shifted(&mut body, column, radius);
        let weight = tap_weight(&mut body, column, column == radius, &taps);
        for (sum, term) in sums.iter_mut().zip(&summed) {
            let tap = format!("{}_tap_{column}", term.value);
            let product = body.op("Mul", &[&weight, &tap], &format!("{}_weighted_{column}", term.value));
            *sum = body.op("Add", &[sum, &product], &name(&format!("{}_sum", term.value)));
        }
        weight_sum = body.op("Add", &[&weight_sum, &weight], &name("weight_sum"));
    }
    for term in &summed {
        body.output(&format!("{}_sum_out", term.value), data_type::FLOAT, &free(3));
    }
    body.output("weight_sum_out", data_type::FLOAT, &free(1));
    body.finish()
}

/// The row of every term shifted to `column` of the window: names in the order of [`TERMS`].
fn shifted(body: &mut GraphBuilder, column: usize, radius: usize) -> Vec<String> {
    let start = body.ints(&format!("start_{column}"), &[1], &[column as i64]);
    // The end counted from the right, so that it does not depend on the image's width.
    let end = match column as i64 - 2 * radius as i64 {
        0 => i64::MAX,
        negative => negative,
    };
    let end = body.ints(&format!("end_{column}"), &[1], &[end]);
    TERMS
        .iter()
        .map(|term| {
            let row = format!("{}_row", term.value);
            let tap = format!("{}_tap_{column}", term.value);
            body.op("Slice", &[&row, &start, &end, "shift_axis"], &tap)
        })
        .collect()
}

/// w_i of Eq. 11 for the pixels of one column of the window; tau where i = c.
fn tap_weight(body: &mut GraphBuilder, column: usize, centre: bool, taps: &[String]) -> String {
    let mut exponent: Option<String> = None;
    for (term, tap) in TERMS.iter().zip(taps) {
        let name = |part: &str| format!("{}_{part}_{column}", term.value);
        let difference = body.op("Sub", &[term.value, tap], &name("difference"));
        let mut distance = body.op_with(
            "ReduceSumSquare",
            &[&difference],
            &name("distance"),
            vec![ints("axes", &[1]), int("keepdims", 1)],
        );
        if term.logarithmic {
            let plus_one = body.op("Add", &[&distance, "f_one"], &name("plus_one"));
            distance = body.op("Log", &[&plus_one], &name("log"));
        }
        let scaled = body.op("Mul", &[&distance, term.bandwidth], &name("scaled"));
        exponent = Some(match exponent {
            None => scaled,
            Some(sum) => body.op("Add", &[&sum, &scaled], &name("exponent")),
        });
    }
    let exponent = exponent.expect("there are terms");
    let weight = body.op("Exp", &[&exponent], &format!("weight_{column}"));
    if centre {
        return body.op("Where", &["is_centre", "tau", &weight], "centre_weight");
    }
    weight
}
