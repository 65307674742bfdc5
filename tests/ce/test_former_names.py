"""Options under the names that they had in earlier versions stay valid."""

import dataclasses

import pytest

import ce


def test_the_constructor_takes_them_with_a_notice():
    with pytest.warns(DeprecationWarning, match="look_share is called mode_search_share now"):
        options = ce.MixtureOptions(budget=20_000, look_share=0.05)
    assert options == ce.MixtureOptions(budget=20_000, mode_search_share=0.05)
    assert dataclasses.replace(options, budget=30_000).mode_search_share == 0.05


def test_options_by_name_are_given_their_present_names():
    with pytest.warns(DeprecationWarning, match="mode_search_share"):
        assert ce.present_options("mixture", {"look_share": 0, "rho": 0.1}) == {
            "mode_search_share": 0,
            "rho": 0.1,
        }
    assert ce.present_options("naive", {"look_share": 0}) == {"look_share": 0}


def test_an_option_given_under_both_names_is_refused():
    with pytest.raises(TypeError, match="former name of mode_search_share"):
        ce.MixtureOptions(look_share=0.05, mode_search_share=0.1)


def test_a_name_that_never_was_is_refused():
    with pytest.raises(TypeError, match="look_shares"):
        ce.MixtureOptions(look_shares=0.05)


def test_a_block_of_standard_normals_is_found_under_its_former_name():
    assert ce.White is ce.StandardNormal
