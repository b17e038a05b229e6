"""Tests of projects on a service without login; tests/service/api/test_projects.py covers projects with login."""

from __future__ import annotations

from service.access.roles import Role
from tests.service.conftest import OBJ, Service


def test_without_login_all_projects_are_visible(service: Service) -> None:
    projects = service.farm.access.projects
    projects.add("film")
    scene = service.http.post("/api/scenes", params={"project": "film"}, files={"files": ("a.obj", OBJ)}).json()
    assert [found["id"] for found in service.http.get("/api/scenes").json()] == [scene["id"]]
    assert service.http.get(f"/api/scenes/{scene['id']}").status_code == 200
    plain = service.http.post("/api/scenes", files={"files": ("a.obj", OBJ)}).json()
    assert (plain["project"], plain["id"] != scene["id"]) == ("", True)


def test_deleted_user_loses_membership(service: Service) -> None:
    access = service.farm.access
    access.users.add("anna", Role.VIEW, None)
    access.projects.add("film")
    assert access.projects.add_member("film", "anna").members == ["anna"]
    access.users.remove("anna")
    access.users.add("anna", Role.VIEW, None)
    assert access.projects.find("film").members == []
