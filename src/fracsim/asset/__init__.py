"""asset"""
