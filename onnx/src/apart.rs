//! Several graphs in one: the same operators for each network, on values of their own.

use crate::messages::{GraphProto, NodeProto};

/// Adds `other` to a graph. Its values get the prefix, so that they stay apart, but for the `shared` ones, which are
/// the same in both; its inputs and outputs become further ones.
pub(crate) fn add_apart(graph: &mut GraphProto, mut other: GraphProto, prefix: &str, shared: &[&str]) {
    let rename = |name: &mut String| {
        // An empty name stands for an input that is left out.
        if !name.is_empty() && !shared.contains(&name.as_str()) {
            name.insert_str(0, prefix);
        }
    };
    rename_all(&mut other, &rename);
    other.input.retain(|input| !input.name.as_deref().is_some_and(|name| shared.contains(&name)));
    graph.node.append(&mut other.node);
    graph.initializer.append(&mut other.initializer);
    graph.input.append(&mut other.input);
    graph.output.append(&mut other.output);
}

/// Renames every value of a graph and of the graphs inside its nodes.
fn rename_all(graph: &mut GraphProto, rename: &impl Fn(&mut String)) {
    graph.initializer.iter_mut().filter_map(|tensor| tensor.name.as_mut()).for_each(rename);
    let values = graph.input.iter_mut().chain(&mut graph.output);
    values.filter_map(|value| value.name.as_mut()).for_each(rename);
    for NodeProto { input, output, name, attribute, .. } in &mut graph.node {
        input.iter_mut().chain(output).chain(name).for_each(rename);
        attribute.iter_mut().filter_map(|attribute| attribute.g.as_mut()).for_each(|body| rename_all(body, rename));
    }
}
